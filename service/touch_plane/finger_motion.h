// How a finger moves, from its poses.
#pragma once

#include <array>
#include <chrono>
#include <cmath>

#include "service/contact/touch_model.h"

namespace teletact::service {

class FingerMotion {
 public:
  using Clock = std::chrono::steady_clock;
  // Sets how the pose moves: its velocity, and how fast that turns.
  void see(TouchPose& pose, Clock::time_point now) {
    constexpr double kSmoothedS = 0.005, kGapS = 0.1, kMinMS = 0.01, kMaxTurnRadS = 60;
    const double passed_s = std::chrono::duration<double>(now - at_).count();
    const Vector3 before_m_s = velocity_m_s_;
    if (!(passed_s < kGapS)) velocity_m_s_ = acceleration_m_s2_ = {};
    if (passed_s > 0 && passed_s < kGapS) {
      // What arrives in a burst moves by no more than over the time that is smoothed.
      const double share = -std::expm1(-passed_s / kSmoothedS),
                   slow = -std::expm1(-passed_s / (2 * kSmoothedS));
      for (std::size_t k = 0; k < 3; ++k) {
        velocity_m_s_[k] += share * ((pose.position_m[k] - position_m_[k]) / passed_s - velocity_m_s_[k]);
        acceleration_m_s2_[k] +=
            slow * ((velocity_m_s_[k] - before_m_s[k]) / passed_s - acceleration_m_s2_[k]);
      }
    }
    if (passed_s > 0) at_ = now, position_m_ = pose.position_m;
    pose.velocity_m_s = velocity_m_s_;
    const auto [vx, vy, vz] = velocity_m_s_;
    const double squares = vx * vx + vz * vz;
    pose.turn_rad_s =
        squares > kMinMS * kMinMS ? (vx * acceleration_m_s2_[2] - vz * acceleration_m_s2_[0]) / squares : 0;
    if (!(std::abs(pose.turn_rad_s) < kMaxTurnRadS)) pose.turn_rad_s = 0;
    // What is smoothed is late.
    const double late = pose.turn_rad_s * kSmoothedS;
    pose.velocity_m_s[0] = vx * std::cos(late) - vz * std::sin(late);
    pose.velocity_m_s[2] = vx * std::sin(late) + vz * std::cos(late);
  }

 private:
  Clock::time_point at_{};
  Vector3 position_m_{}, velocity_m_s_{}, acceleration_m_s2_{};
};

}  // namespace teletact::service
