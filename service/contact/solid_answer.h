// What a contact on the nodes of solid tissue answers: forces, pressures, strain.
#pragma once

#include <cstddef>
#include <vector>

#include "service/contact/layered_touch.h"
#include "service/contact/solid_patch.h"
#include "service/contact/touch_model.h"
#include "service/tissue/solid/solid_tissue.h"

namespace teletact::service {

// What the nodes of a solid may leave its force off by, beside what is learned (T9.4): error of a round tip's
// force that is left to nodes so far apart, over the square of their distance over the contact's radius.
inline constexpr double kOfMesh = 0.165;

// The same where the layered part is exact, pressed at a node of the surface. `layer_pa`: E0 there;
// `beyond_layers`: variance of ln(E / E0) in what is felt.
double mesh_beyond_layers(const SolidTissue&, double layer_pa, std::size_t node, double beyond_layers);

// To an answer on a row of nodes; only of a round tip in contact: under edges no rule is known.
void add_solid_budget(const SolidGrid&, std::size_t row, const Fingertip&, double indentation_m,
                      double of_mesh, ContactAnswer&);

// Of the nodes of a row that press.
std::vector<NodalPressure> pressure_of(const SolidGrid&, std::size_t row, const LinearisedContact&);
double force_of(const SolidGrid&, const LinearisedContact&);  // N, into the tissue
// F = -dU/dpose and its tangent. Throws std::domain_error where they are not finite.
void set_forces(const SolidEnergy&, ContactAnswer&);
void set_strain(const SolidTissue&, std::size_t row, const LinearisedContact&, double depth_m,
                ContactAnswer&);
// Largest principal strain below a round contact, by its mean pressure.
double contact_strain(double poisson_ratio, double pressure_pa, double youngs_modulus_pa);
// That, or all of the tissue's, whichever is more.
void set_strain(double below_contact, double of_all, ContactAnswer&);
// Error of a linear model under a round tip, of tissue that is neo-Hookean (T9.4).
ForceError finite_strain(const Fingertip&, double indentation_m);

// Of the surface, the block being periodic.
std::size_t nearest_node(const SolidGrid&, const Vector3& pose);
// Modulus of the elements around a node, Pa.
double modulus_near_pa(const SolidTissue&, std::size_t row, std::size_t node);
// The exact touch of the layers alone, its pressure on the nearest node.
void touch_layers(const SolidGrid&, const LayeredTouch::At&, const Vector3& pose, ContactAnswer&);

}  // namespace teletact::service
