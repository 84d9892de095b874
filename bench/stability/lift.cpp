#include "bench/stability/lift.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "bench/stability/plant.h"
#include "bench/stability/rig.h"
#include "bench/stability/servo_period.h"

namespace teletact::bench {
namespace {

using client::ToolPose;

constexpr double kBeginM = 0.034;  // on the flank of an inclusion
constexpr double kStartS = 0.6;    // the start-up ramp is over
constexpr double kHoverM = 0.002, kPressMS = 0.05, kHeldS = 0.3, kTapHz = 3, kTapsS = 1;
constexpr double kBeyond = 1.05;      // of the depth at which the force is the device's largest
constexpr double kInAirTicks = 20;    // and another contact begins
constexpr double kStretchedM = 0.03;  // a hand's spring, at most
constexpr double kDampingNSM = 0.5;

// Depth over time, from the start on.
class DepthPath {
 public:
  DepthPath(const LiftOptions& options, double depth_m)
      : tap_(options.motion == LiftMotion::kTap), lift_m_s_(options.lift_m_s), way_m_(kHoverM + depth_m) {}
  double ends_s() const { return tap_ ? kTapsS : 2 * once_s(); }
  double at(double time_s) const {
    const double t = std::max(time_s, 0.0);
    if (tap_) return way_m_ * (1 - std::cos(2 * M_PI * kTapHz * std::min(t, kTapsS))) / 2 - kHoverM;
    const double within_s = t < ends_s() ? std::fmod(t, once_s()) : once_s();
    const double pressed_m = std::min(kPressMS * within_s, way_m_);
    const double lifted_m = lift_m_s_ * std::max(within_s - way_m_ / kPressMS - kHeldS, 0.0);
    return std::max(pressed_m - lifted_m, 0.0) - kHoverM;
  }

 private:
  double once_s() const { return way_m_ / kPressMS + kHeldS + way_m_ / lift_m_s_ + kHeldS; }
  bool tap_;
  double lift_m_s_, way_m_;
};

// The finger itself, or what a hand makes of it.
class Finger {
 public:
  Finger(const LiftOptions& options, const DepthPath& path) : path_(path) {
    if (options.hand == nullptr) return;
    plant_.emplace(PlantOptions{.mass_kg = options.device.apparent_mass_kg + options.hand->mass_kg,
                                .damping_n_s_m = kDampingNSM,
                                .friction_n = options.device.friction_n,
                                .hand_stiffness_n_m = options.hand->stiffness_n_m,
                                .hand_damping_n_s_m = options.hand->damping_n_s_m,
                                .step_s = kServoS},
                   Vector3(kBeginM, -kHoverM, 0));
  }
  ToolPose pose() const {
    if (plant_) return {plant_->position_m(), plant_->velocity_m_s()};
    return {{kBeginM, path_.at(time_s_), 0},
            {0, (path_.at(time_s_) - path_.at(time_s_ - kServoS)) / kServoS, 0}};
  }
  void step(const Vector3& force_n) {
    const double now_m = path_.at(time_s_), then_m = path_.at(time_s_ + kServoS);
    if (plant_) plant_->step(force_n, {{kBeginM, now_m, 0}, {0, (then_m - now_m) / kServoS, 0}});
    time_s_ += kServoS;
  }

 private:
  const DepthPath& path_;
  std::optional<Plant> plant_;
  double time_s_ = -kStartS;
};

double late_s(const LiftOptions& options) {
  if (options.renderer.rfind("kalman", 0) == 0) return kServoS / 2;
  const double periods = options.renderer == "interpolate" ? 2 : 1;
  return kServoS / 2 + options.model_delay_s + periods * options.update_s;
}

}  // namespace

LiftResult run_lift(const LiftOptions& options) {
  const StabilityTissue tissue(options.scene, options.stiffness_n_m);
  const double stiffness_n_m = -tissue.force_n({kBeginM, 1, 0}).y();
  const double depth_m = std::min(kBeyond * options.device.largest_force_n / stiffness_n_m,
                                  options.scene == Scene::kHomogeneous ? kDeepestM : kDeepestOnFlankM);
  // What the tissue's resistance takes from a hand is added.
  const double resisted_m =
      options.hand == nullptr ? 0
                              : std::min(stiffness_n_m * depth_m / options.hand->stiffness_n_m, kStretchedM);
  const DepthPath path(options, depth_m + resisted_m);
  Finger finger(options, path);
  RigOptions rig{.renderer = options.renderer,
                 .profile = options.device,
                 .update_s = options.update_s,
                 .model_delay_s = options.model_delay_s,
                 .asks_until_s = kStartS};
  rig.profile.damping_n_s_m = options.damping_known ? kDampingNSM : 0;
  Sensor sensor(options.device.resolution_m, finger.pose().position_m);
  Controller controller(rig);
  Answers answers(tissue, rig);
  const double late = late_s(options);
  LiftResult result;
  double energy_j = 0, allowed_j = 0, in_air = 0, ticks = 0;
  for (std::size_t tick = 0; kServoS * double(tick) < kStartS + path.ends_s() + kHeldS; ++tick) {
    const ToolPose exact = finger.pose(), read = sensor.read(exact);
    const Vector3 force_n = controller.tick(read, answers.at(tick, read), kServoS * double(tick));
    finger.step(force_n);
    const Vector3 moved_m = finger.pose().position_m - exact.position_m;
    const double above_m = -exact.position_m.y();
    if (above_m > options.device.resolution_m) result.in_air_n = std::max(result.in_air_n, force_n.norm());
    if (above_m < moved_m.norm()) {
      const double speed_m_s = moved_m.norm() / kServoS;
      allowed_j += stiffness_n_m * moved_m.norm() * (late * speed_m_s + options.device.resolution_m / 2);
      in_air = 0;
    } else if (++in_air > kInAirTicks) {
      energy_j = allowed_j = 0;
    }
    energy_j -= force_n.dot(moved_m);
    result.given_j = std::max(result.given_j, -energy_j);
    result.stored_j = std::max(result.stored_j, energy_j);
    if (energy_j < 0) result.over_allowed = std::max(result.over_allowed, -energy_j / allowed_j);
    result.largest_n = std::max(result.largest_n, force_n.norm());
    if (kServoS * double(tick) < kStartS) continue;
    ++ticks;
    if (controller.last().state != client::ServoState::kEnabled) continue;
    ++result.enabled_share;
    result.degraded_share += controller.last().degraded;
    result.damping_share += controller.last().damping_n_s_m > 0;
  }
  result.degraded_share /= std::max(result.enabled_share, 1.0);
  result.damping_share /= std::max(result.enabled_share, 1.0);
  result.enabled_share /= ticks;
  return result;
}

}  // namespace teletact::bench
