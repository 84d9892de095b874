// What a touch is opened with, and whether it can be touched so.
#pragma once

#include <optional>
#include <string>

#include "service/base/limits.h"
#include "service/contact/touch_model.h"

namespace teletact::service {

struct TouchOptions {
  Fingertip fingertip;
  double layer_depth_m = 0;
  SolvePath path = SolvePath::kAuto;
  std::string client = {};                   // in whose turn layers are made ready
  std::optional<Vector3> layer_normal = {};  // as it was asked for; none: as the model says
  std::optional<Tolerance> tolerance = {};   // answers that may be off by more are not trusted
  bool pressure = false;                     // answers have to tell pressures
};

// With what its tip's shape does not use as in every other tip of that shape.
TouchOptions canonical(TouchOptions);
// Shares of the force are of a solid's surface and frictionless round tips.
bool has_shares(const TouchOptions&, const Layer&, bool solid);
// Throws std::invalid_argument (field named) for what is beyond the limits, or no normal of this layer. What
// the tissue's model does not do, TouchModels::check() refuses.
void check(const TouchOptions&, const Layer&, const Limits&);

}  // namespace teletact::service
