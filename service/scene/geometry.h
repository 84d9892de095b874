// The piece of tissue that a scene stands for: 0 <= x <= width, 0 <= y <= depth, plane strain (T4).
#pragma once

#include <fmt/format.h>

#include <stdexcept>

#include "service/base/choices.h"
#include "service/base/limits.h"
#include "service/tissue/grid.h"

namespace teletact::service {

// Throws std::invalid_argument, one line with the field and the remedy, for a value outside of the two and
// for NaN.
template <class T>
void require_between(const char* field, T value, T least, T most, const char* remedy) {
  if (value >= least && value <= most) return;
  throw std::invalid_argument(
      fmt::format("{}: {} is not within [{}, {}]; {}", field, value, least, most, remedy));
}

struct SceneGeometry {
  double width_m = 0, depth_m = 0;
  double poisson_ratio = choices::kPoissonRatio;
  double thickness_m = 0.010;  // out-of-plane contact width of the finger
  Supports supports;
  bool linear = false;  // it does not stiffen with strain
};

// Throws std::invalid_argument naming the field of SceneGeometry and what it may be.
void validate(const SceneGeometry&, const Limits& = {});

}  // namespace teletact::service
