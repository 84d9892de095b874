// What the nodes of a solid may leave its force off by, beside what is learned (T9.4).
#pragma once

#include <cstddef>

#include "service/contact/touch_model.h"
#include "service/tissue/solid/solid_tissue.h"

namespace teletact::service {

// Error of a round tip's force that is left to nodes so far apart, over the square of their distance over the
// contact's radius.
inline constexpr double kOfMesh = 0.165;

// The same where the layered part is exact, pressed at a node of the surface. `layer_pa`: E0 there;
// `beyond_layers`: variance of ln(E / E0) in what is felt.
double mesh_beyond_layers(const SolidTissue&, double layer_pa, std::size_t node, double beyond_layers);

// To an answer on a row of nodes; only of a round tip in contact: under edges no rule is known.
void add_solid_budget(const SolidGrid&, std::size_t row, const Fingertip&, double indentation_m,
                      double of_mesh, ContactAnswer&);

}  // namespace teletact::service
