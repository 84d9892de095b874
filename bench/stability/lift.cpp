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

constexpr double kFlankM = 0.034, kMiddleM = 0.03, kSlidM = 0.02;  // of an inclusion; and how far off it
constexpr double kAnsweredS = 0.6;  // after the first answer the start-up ramp is over
constexpr double kHoverM = 0.002, kPressMS = 0.05, kHeldS = 0.3, kTapHz = 3, kTapsS = 1;
constexpr double kBeyond = 1.05;      // of the depth at which the force is the device's largest
constexpr double kInAirTicks = 20;    // and another contact begins
constexpr double kStretchedM = 0.03;  // a hand's spring, at most
constexpr double kDampingNSM = 0.5;
constexpr double kHandNSM = 2;  // T5.7
constexpr double kChangesS = 0.3, kHarder = 4.0 / 3;

// Depth over time, from the start on.
class DepthPath {
 public:
  DepthPath(const LiftOptions& options, double depth_m)
      : tap_(options.motion == LiftMotion::kTap),
        begin_m_(begin_m(options)),
        slid_m_(options.motion == LiftMotion::kSlide ? kSlidM : 0),
        lift_m_s_(options.lift_m_s),
        way_m_(kHoverM + depth_m) {}
  static double begin_m(const LiftOptions& options) {
    return options.motion == LiftMotion::kSlide ? kMiddleM : kFlankM;
  }
  // Within the time that it is held; in the air it goes back.
  double along(double time_s) const {
    if (slid_m_ == 0) return begin_m_;
    const double held_s = std::fmod(std::max(time_s, 0.0), once_s()) - way_m_ / kPressMS;
    const double lifted_s = held_s - kHeldS - way_m_ / lift_m_s_;
    const auto eased = [](double share) { return (1 - std::cos(M_PI * std::clamp(share, 0.0, 1.0))) / 2; };
    return begin_m_ + slid_m_ * (eased(held_s / kHeldS) - eased(lifted_s / kHeldS));
  }
  Vector3 place(double time_s) const { return {along(time_s), at(time_s), 0}; }
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
  double begin_m_, slid_m_, lift_m_s_, way_m_;
};

double begins_s(const LiftOptions& options) {
  return kAnsweredS + options.model_delay_s;
}

// The finger itself, or what a hand makes of it.
class Finger {
 public:
  Finger(const LiftOptions& options, const DepthPath& path) : path_(path), time_s_(-begins_s(options)) {
    if (options.hand == nullptr) return;
    plant_.emplace(PlantOptions{.mass_kg = options.device.apparent_mass_kg + options.hand->mass_kg,
                                .damping_n_s_m = kDampingNSM,
                                .friction_n = options.device.friction_n,
                                .hand_stiffness_n_m = options.hand->stiffness_n_m,
                                .hand_damping_n_s_m = options.hand->damping_n_s_m,
                                .step_s = kServoS},
                   path_.place(time_s_));
  }
  ToolPose pose() const {
    if (plant_) return {plant_->position_m(), plant_->velocity_m_s()};
    const Vector3 now_m = path_.place(time_s_);
    return {now_m, (now_m - path_.place(time_s_ - kServoS)) / kServoS};
  }
  void step(const Vector3& force_n) {
    const Vector3 now_m = path_.place(time_s_), then_m = path_.place(time_s_ + kServoS);
    if (plant_) plant_->step(force_n, {now_m, (then_m - now_m) / kServoS});
    time_s_ += kServoS;
  }

 private:
  const DepthPath& path_;
  std::optional<Plant> plant_;
  double time_s_;
};

double late_s(const LiftOptions& options) {
  if (options.renderer == "law" || options.renderer.rfind("kalman", 0) == 0) return kServoS / 2;
  const double periods = options.renderer == "interpolate" ? 2 : 1;
  return kServoS / 2 + options.model_delay_s + periods * options.update_s;
}

}  // namespace

LiftResult run_lift(const LiftOptions& options) {
  const StabilityTissue tissue(options.scene, options.stiffness_n_m);
  const StabilityTissue harder(options.scene, kHarder * options.stiffness_n_m);
  const bool changes = options.renderer == "law" && options.law != LawTold::kOne;
  const double stiffness_n_m =
      std::min((changes ? kHarder : 1) * -tissue.force_n({DepthPath::begin_m(options), 1, 0}).y(),
               options.device.largest_stiffness_n_m);
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
                 .asks_until_s = begins_s(options),
                 .stall_s = options.stall_s};
  rig.profile.damping_n_s_m = options.damping_known ? kDampingNSM : 0;
  Sensor sensor(options.device.resolution_m, finger.pose().position_m);
  Controller controller(rig);
  Answers answers(tissue, rig);
  const double late = late_s(options);
  std::uint64_t version = 1;
  if (options.renderer == "law") controller.take_law(tissue.law(version));
  const std::size_t changes_ticks = std::size_t(std::lround(kChangesS / kServoS));
  LiftResult result;
  const bool stated = rig.profile.damping_n_s_m > 0 || rig.profile.friction_n > 0;
  double energy_j = 0, paid_j = 0, allowed_j = 0, in_air = 0, ticks = 0;
  for (std::size_t tick = 0; kServoS * double(tick) < begins_s(options) + path.ends_s() + kHeldS; ++tick) {
    if (changes && tick > 0 && tick % changes_ticks == 0) {
      const StabilityTissue& now = ++version % 2 == 0 ? harder : tissue;
      answers.is(now, version);
      // That goes: of a place far away.
      const bool goes = options.law == LawTold::kComingAndGoing && version % 4 >= 2;
      controller.take_law(now.law(version, goes ? 0.002 : 0.124));
    }
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
      energy_j = paid_j = allowed_j = 0;
    }
    energy_j -= force_n.dot(moved_m);
    result.given_j = std::max(result.given_j, -energy_j);
    result.stored_j = std::max(result.stored_j, energy_j);
    if (energy_j < 0) result.over_allowed = std::max(result.over_allowed, -energy_j / allowed_j);
    if (above_m < moved_m.norm())
      paid_j += rig.profile.friction_n * moved_m.norm() +
                (stated ? rig.profile.damping_n_s_m : kHandNSM) * moved_m.squaredNorm() / kServoS;
    if (energy_j + paid_j < 0)
      result.over_paid = std::max(result.over_paid, -(energy_j + paid_j) / allowed_j);
    result.largest_n = std::max(result.largest_n, force_n.norm());
    result.min_ledger_j = std::min(result.min_ledger_j, controller.last().balance_j);
    if (kServoS * double(tick) < begins_s(options)) continue;
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
