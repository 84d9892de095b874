// What a contact on the nodes of solid tissue answers: forces, pressures, strain.
#pragma once

#include <cstddef>
#include <vector>

#include "service/contact/layered_touch.h"
#include "service/contact/solid_node.h"
#include "service/contact/touch_model.h"

namespace teletact::service {

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
// Error of a linear model under a round tip (T9.4).
ForceError finite_strain(const Fingertip&, double indentation_m);

// Of the surface, the block being periodic.
std::size_t nearest_node(const SolidGrid&, const Vector3& pose);
// Modulus of the elements around a node, Pa.
double modulus_near_pa(const SolidTissue&, std::size_t row, std::size_t node);
// The exact touch of the layers alone, its pressure on the nearest node.
void touch_layers(const SolidGrid&, const LayeredTouch::At&, const Vector3& pose, ContactAnswer&);

}  // namespace teletact::service
