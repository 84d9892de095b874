#include "client/haptic/hand.h"

#include <algorithm>
#include <cmath>

namespace teletact::client {

Hand::Hand(const HandOptions& options) : options_(options) {
  target_m_ = Vector3(options.start_m, -options.hover_m, 0);
}

Vector3 Hand::force(const Vector3& position_m, const Vector3& velocity_m_s) const noexcept {
  return options_.stiffness_n_m * (target_m_ - position_m) +
         options_.damping_n_s_m * (target_velocity_m_s_ - velocity_m_s);
}

void Hand::intend(const OperatorView& view, const Vector3& position_m, double dt_s) noexcept {
  const Vector3 before_m = target_m_;
  const double indentation_m = view.surface.depth_m(position_m);
  held_ = resume_ = false;
  if (!view.force_on) {
    // Nothing is felt: lift, and once out of contact with answers flowing ask for force.
    phase_ = Phase::kHover;
    speed_m_s_ = correction_m_ = 0;
    const double hover_m = view.surface.offset_m - options_.hover_m;
    const double most_m = options_.speed_m_s * dt_s;
    target_m_.y() += std::clamp(hover_m - target_m_.y(), -most_m, most_m);
    // The button is pressed and released until it has been heard.
    constexpr double kPressS = 0.05;
    const bool asks = view.link_alive && indentation_m < -options_.hover_m / 2;
    resume_ = asks && std::fmod(asking_s_, 2 * kPressS) < kPressS;
    asking_s_ = asks ? asking_s_ + dt_s : 0;
  } else if (phase_ == Phase::kHover) {
    if (view.covered) phase_ = Phase::kPress;
  } else {
    press(view, indentation_m, dt_s);
    if (phase_ == Phase::kSweep) sweep(view, dt_s);
  }
  target_velocity_m_s_ = dt_s > 0 ? Vector3((target_m_ - before_m) / dt_s) : Vector3::Zero();
}

// Down to the depth asked for, then the slow correction of what the tissue's resistance takes from it.
void Hand::press(const OperatorView& view, double indentation_m, double dt_s) noexcept {
  const double depth_m = view.surface.offset_m + options_.indentation_m + correction_m_;
  if (phase_ == Phase::kPress) {
    target_m_.y() = std::min(target_m_.y() + options_.approach_m_s * dt_s, depth_m);
    if (target_m_.y() < depth_m) return;
    phase_ = Phase::kSweep;
  }
  const double most_m = 5 * options_.indentation_m;
  correction_m_ += options_.depth_gain_1_s * (options_.indentation_m - indentation_m) * dt_s;
  correction_m_ = std::clamp(correction_m_, -options_.indentation_m, most_m);
  target_m_.y() = view.surface.offset_m + options_.indentation_m + correction_m_;
}

void Hand::sweep(const OperatorView& view, double dt_s) noexcept {
  const double covered_m =
      direction_ > 0 ? view.region.end_x_m - options_.border_m : view.region.begin_x_m + options_.border_m;
  const double end_m = direction_ > 0 ? options_.end_m : options_.begin_m;
  const double to_end_m = direction_ * (end_m - target_m_.x());
  const double to_border_m = view.covered ? direction_ * (covered_m - target_m_.x()) : 0;
  // v^2 = 2 a s: the speed from which the hand still stops in time.
  const auto stopping = [this](double distance_m) {
    return std::sqrt(2 * options_.acceleration_m_s2 * std::max(distance_m, 0.0));
  };
  const double free_m_s =
      std::min({speed_m_s_ + options_.acceleration_m_s2 * dt_s, options_.speed_m_s, stopping(to_end_m)});
  speed_m_s_ = std::min(free_m_s, stopping(to_border_m));
  held_ = speed_m_s_ < free_m_s;
  constexpr double kArrivedM = 2e-5;
  if (to_end_m <= std::max(speed_m_s_ * dt_s, kArrivedM)) {
    target_m_.x() = end_m;
    direction_ = -direction_;
    speed_m_s_ = 0;
    held_ = false;
    passes_.fetch_add(1, std::memory_order_relaxed);
    return;
  }
  target_m_.x() += direction_ * speed_m_s_ * dt_s;
}

}  // namespace teletact::client
