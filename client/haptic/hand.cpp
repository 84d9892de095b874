#include "client/haptic/hand.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace teletact::client {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;

// How far it is to the border that lies ahead; `unit`: along the surface.
double to_border_m(const Region& region, double inside_m, const Vector3& from_m, const Vector3& unit) {
  const auto along = [inside_m](double from_m, double direction, double begin_m, double end_m) {
    if (direction == 0) return HUGE_VAL;
    return ((direction > 0 ? end_m - inside_m : begin_m + inside_m) - from_m) / direction;
  };
  return std::min(along(from_m.x(), unit.x(), region.begin_x_m, region.end_x_m),
                  along(from_m.z(), unit.z(), region.begin_z_m, region.end_z_m));
}

}  // namespace

Hand::Hand(const HandOptions& options) : options_(options) {
  target_m_.y() = -options.hover_m;
  go_to(options.start_m);
}

void Hand::go_to(double along_m) noexcept {
  along_m_ = along_m;
  double across_m = options_.across_m;
  if (const double radius_m = options_.circle_radius_m; radius_m > 0) {
    const double angle = kTurn * (along_m_ - options_.begin_m) / radius_m;
    along_m += radius_m * std::sin(angle);
    across_m += radius_m * std::cos(angle);
  }
  target_m_.x() = options_.along_z ? across_m : along_m;
  target_m_.z() = options_.along_z ? along_m : across_m;
}

Vector3 Hand::forward() const noexcept {
  double along = 1, across = 0;
  if (const double radius_m = options_.circle_radius_m; radius_m > 0) {
    const double angle = kTurn * (along_m_ - options_.begin_m) / radius_m;
    along += kTurn * std::cos(angle);
    across -= kTurn * std::sin(angle);
  }
  return options_.along_z ? Vector3(across, 0, along) : Vector3(along, 0, across);
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
    const double max_m = options_.speed_m_s * dt_s;
    target_m_.y() += std::clamp(hover_m - target_m_.y(), -max_m, max_m);
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
  const double max_m = 5 * options_.indentation_m;
  correction_m_ += options_.depth_gain_1_s * (options_.indentation_m - indentation_m) * dt_s;
  correction_m_ = std::clamp(correction_m_, -options_.indentation_m, max_m);
  target_m_.y() = view.surface.offset_m + options_.indentation_m + correction_m_;
}

void Hand::sweep(const OperatorView& view, double dt_s) noexcept {
  const Vector3 forward = this->forward();
  const double by_the_metre = forward.norm();  // of the line, how long the way is
  const double line_end_m = direction_ > 0 ? options_.end_m : options_.begin_m;
  const double to_end_m = by_the_metre * direction_ * (line_end_m - along_m_);
  const double covered_m = view.covered ? to_border_m(view.region, options_.border_m, target_m_,
                                                      direction_ / by_the_metre * forward)
                                        : 0;
  // v^2 = 2 a s: the speed from which the hand still stops in time.
  const auto stopping = [this](double distance_m) {
    return std::sqrt(2 * options_.acceleration_m_s2 * std::max(distance_m, 0.0));
  };
  const double free_m_s =
      std::min({speed_m_s_ + options_.acceleration_m_s2 * dt_s, options_.speed_m_s, stopping(to_end_m)});
  speed_m_s_ = std::min(free_m_s, stopping(covered_m));
  held_ = speed_m_s_ < free_m_s;
  constexpr double kArrivedM = 2e-5;
  if (to_end_m <= std::max(speed_m_s_ * dt_s, kArrivedM)) {
    go_to(line_end_m);
    direction_ = -direction_;
    speed_m_s_ = 0;
    held_ = false;
    passes_.fetch_add(1, std::memory_order_relaxed);
    return;
  }
  go_to(along_m_ + direction_ * speed_m_s_ * dt_s / by_the_metre);
}

}  // namespace teletact::client
