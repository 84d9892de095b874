// The single-node contact on solid tissue (T4.5, T8.4): one constraint on the weighted mean of the nodes
// around the pose, as touch_node (touch.h) has it in the plane.
#pragma once

#include "service/contact/solid_patch.h"

namespace teletact::service {

struct SolidTouch {
  SolidEnergy energy;
  LinearisedContact contact;
};

// U = max over f of f.d - f.(B^T S B) f / 2: B the weights, the product of those along x and along z
// (footprint, fingertip.h), d = [0, indentation, 0]; frictionless: f_y alone. Bilateral: the weights are >=
// 0. The contact is linear as it stands: it has forces, no skin and no w. Throws as patch_under, and as
// footprint; std::domain_error where the compliance is not positive definite.
SolidTouch touch_node(const SolidGrid&, const RecycledCompliance&, const Fingertip&, const Vector3& pose);

}  // namespace teletact::service
