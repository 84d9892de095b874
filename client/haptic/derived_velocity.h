// Velocity of a device that states none, from its positions as they come: over the time from one change to
// the next, so that neither a slow sampling nor the steps of an encoder make it jump. A device that rests
// longer than that slows down to nothing.
#pragma once

#include <cstdint>

#include "client/render/renderer.h"

namespace teletact::client {

class DerivedVelocity {
 public:
  void restart() noexcept { *this = DerivedVelocity(); }
  // A position that is no number has no velocity, and is no beginning for the next.
  Vector2 at(const Vector2& position_m, std::int64_t now_ns) noexcept {
    if (!position_m.allFinite()) {
      restart();
      return Vector2::Zero();
    }
    const double since_s = 1e-9 * static_cast<double>(now_ns - changed_ns_);
    if (!known_) {
      known_ = true;
      changed_ns_ = now_ns;
    } else if (position_m != position_m_ && since_s > 0) {
      velocity_m_s_ = (position_m - position_m_) / since_s;
      step_s_ = since_s;
      changed_ns_ = now_ns;
    } else {
      return since_s > step_s_ ? Vector2(velocity_m_s_ * (step_s_ / since_s)) : velocity_m_s_;
    }
    position_m_ = position_m;
    return velocity_m_s_;
  }

 private:
  bool known_ = false;
  Vector2 position_m_ = Vector2::Zero();  // since the last change
  std::int64_t changed_ns_ = 0;
  double step_s_ = 0;  // the last change took
  Vector2 velocity_m_s_ = Vector2::Zero();
};

}  // namespace teletact::client
