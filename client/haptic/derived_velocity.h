// Velocity of a device that states none, from its positions as they come: from change to change, so that a
// slow sampling does not make it jump, and over kWindowS at least, so that neither a tick that comes late or
// early nor a step of an encoder does. It never says more than the way of a window in that time. A device
// that rests longer than from one change to the next slows down to nothing.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

#include "client/clock/clock.h"
#include "client/render/renderer.h"

namespace teletact::client {

class DerivedVelocity {
 public:
  static constexpr double kWindowS = 0.004;

  void restart() noexcept { *this = DerivedVelocity(); }
  // A position that is no number has no velocity, and is no beginning for the next.
  Vector3 at(const Vector3& position_m, std::int64_t now_ns) noexcept {
    if (!position_m.allFinite()) {
      restart();
      return Vector3::Zero();
    }
    if (known_ == 0) {
      keep({position_m, now_ns});
      return Vector3::Zero();
    }
    const double since_s = seconds(now_ns - changes_[0].time_ns);
    if (position_m == changes_[0].position_m || !(since_s > 0))
      return since_s > gap_s_ ? Vector3(velocity_m_s_ * (gap_s_ / since_s)) : velocity_m_s_;
    // Back to the newest change that is a window old.
    std::size_t from = 0;
    while (from + 1 < known_ && seconds(now_ns - changes_[from].time_ns) < kWindowS) ++from;
    const double span_s = std::max(seconds(now_ns - changes_[from].time_ns), kWindowS);
    velocity_m_s_ = (position_m - changes_[from].position_m) / span_s;
    gap_s_ = span_s / static_cast<double>(from + 1);
    keep({position_m, now_ns});
    return velocity_m_s_;
  }

 private:
  struct Change {
    Vector3 position_m = Vector3::Zero();
    std::int64_t time_ns = 0;
  };
  void keep(const Change& change) noexcept {
    std::move_backward(changes_.begin(), changes_.end() - 1, changes_.end());
    changes_[0] = change;
    known_ = std::min(known_ + 1, changes_.size());
  }

  std::array<Change, 16> changes_;  // newest first: a window of them, read up to 4 times a millisecond
  std::size_t known_ = 0;
  double gap_s_ = 0;  // between changes, in the window
  Vector3 velocity_m_s_ = Vector3::Zero();
};

}  // namespace teletact::client
