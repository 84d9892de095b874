// A finger that presses to the largest force and lifts, through every renderer and the safety chain of every
// device: no force is left in the air, and no more comes back than was put in.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <string>

#include "client/haptic/profiles.h"
#include "client/render/force_chain.h"
#include "client/render/renderers.h"
#include "tests/render/analytic_tissue.h"

namespace teletact::client {
namespace {

constexpr double kTickS = 0.001;

struct Spring {
  double stiffness_n_m;
  ForceSample told(const Vector3& position_m, double time_s, std::uint64_t sequence) const {
    ForceSample sample;
    sample.sequence = sequence;
    sample.pose_time_s = time_s;
    sample.contact = position_m.y() > 0;
    sample.foreseen = !sample.contact;
    sample.position_m = {position_m.x(), sample.contact ? position_m.y() : 5e-4, 0};
    sample.force_n = {0, -stiffness_n_m * sample.position_m.y(), 0};
    sample.tangent_n_m(1, 1) = -stiffness_n_m;
    return sample;
  }
};

// Down at 50 mm/s, past where the force is the device's largest, a rest, and up.
struct Motion {
  double depth_m, lift_m_s, slide_m_s;
  static constexpr double kPressMS = 0.05, kHoverM = 0.002, kRestS = 0.1;
  double lifts_s() const { return (kHoverM + depth_m) / kPressMS + kRestS; }
  double ends_s() const { return lifts_s() + (depth_m + 3 * kHoverM) / lift_m_s; }
  Vector3 place(double time_s) const {
    const double pressed_m = std::min(kPressMS * time_s - kHoverM, depth_m);
    return {0.025 + slide_m_s * time_s, pressed_m - lift_m_s * std::max(time_s - lifts_s(), 0.0), 0};
  }
  ToolPose pose(double time_s) const {
    return {place(time_s), (place(time_s) - place(time_s - kTickS)) / kTickS};
  }
};

struct Felt {
  double largest_n = 0, pulled_n = 0, min_energy_j = 0, end_energy_j = 0, stored_j = 0;
  int fades = 0, withheld = 0, in_air = 0, above_cap = 0, held_up = 0;
};

// Answers every 2 ms, 2 ms late.
template <typename Tissue>
Felt lift(const std::string& name, const ForceLimits& limits, const Tissue& tissue, const Motion& motion) {
  const auto renderer = make_renderer(name, kTickS);
  ForceChainOptions options;
  options.limits = limits;
  ForceChain chain(options);
  std::deque<ForceSample> on_the_way;
  Felt felt;
  Vector3 last_n(0, 0, 0), last_m = motion.place(0);
  double energy_j = 0;
  for (int tick = 0; kTickS * tick < motion.ends_s(); ++tick) {
    const double time_s = kTickS * tick;
    const ToolPose pose = motion.pose(time_s);
    if (tick % 2 == 0) on_the_way.push_back(tissue.told(pose.position_m, time_s, tick + 1));
    for (; !on_the_way.empty() && on_the_way.front().pose_time_s + 0.002 <= time_s; on_the_way.pop_front())
      renderer->update(on_the_way.front(), pose, time_s);
    energy_j -= last_n.dot(pose.position_m - last_m);
    const Rendered rendered = renderer->render(pose, time_s, chain.ledger());
    const ForceChainOutput output =
        chain.apply({.rendered = rendered, .pose = pose, .on = true, .enabled_s = 10, .period_s = 0.002});
    const double force_n = output.force_n.norm(), depth_m = std::max(pose.position_m.y(), 0.0);
    const double capped_n = limits.largest_stiffness_n_m * depth_m;
    const double damping_n = output.damping_n_s_m * pose.velocity_m_s.norm();
    felt.in_air += depth_m <= 0 && force_n > 0;
    felt.above_cap += force_n > capped_n * (1 + 1e-12);
    felt.held_up += force_n > rendered.force_n.norm() + damping_n + 1e-12;
    felt.fades += output.fades;
    felt.withheld += output.withholds;
    felt.largest_n = std::max(felt.largest_n, force_n);
    felt.pulled_n = std::max(felt.pulled_n, output.force_n.y());
    felt.stored_j = std::max(felt.stored_j, output.stored_j);
    felt.min_energy_j = std::min(felt.min_energy_j, energy_j);
    last_n = output.force_n;
    last_m = pose.position_m;
  }
  felt.end_energy_j = energy_j;
  return felt;
}

std::vector<DeviceProfile> devices() {
  std::vector<DeviceProfile> all = device_profiles();
  DeviceProfile bare = device_profile("premium-1.5");  // states nothing that dissipates
  bare.name = "bare";
  bare.friction_n = 0;
  all.push_back(bare);
  return all;
}

void expect_nothing_in_the_air(const Felt& felt, const std::string& what) {
  EXPECT_EQ(felt.in_air, 0) << what;
  EXPECT_EQ(felt.above_cap, 0) << what;
  EXPECT_EQ(felt.held_up, 0) << what;
  EXPECT_EQ(felt.fades, 0) << what;
}

TEST(Lift, SpringAtTheLargestForceLeavesNoneInTheAir) {
  for (const DeviceProfile& device : devices())
    for (const std::string& name : renderer_names())
      for (const double share : {0.3, 1.0})
        for (const double lift_m_s : {0.05, 0.3, 0.5}) {
          const double stiffness_n_m = share * device.largest_stiffness_n_m;
          const Motion motion{1.2 * device.largest_force_n / stiffness_n_m, lift_m_s, 0};
          const Felt felt = lift(name, device.limits(), Spring{stiffness_n_m}, motion);
          const std::string what = device.name + ' ' + name + ' ' + std::to_string(stiffness_n_m) + " N/m " +
                                   std::to_string(lift_m_s) + " m/s";
          expect_nothing_in_the_air(felt, what);
          EXPECT_EQ(felt.withheld, 0) << what;
          EXPECT_EQ(felt.pulled_n, 0) << what;  // tissue never pulls
          EXPECT_NEAR(felt.largest_n, device.largest_force_n, 1e-9) << what;
          // A force is as old as half a tick.
          const double late_j = device.largest_force_n * kTickS / 2 * (lift_m_s + Motion::kPressMS);
          const double step_j = stiffness_n_m * std::pow(lift_m_s * kTickS, 2);  // the one that leaves
          EXPECT_GE(felt.min_energy_j, -late_j - step_j) << what;
        }
}

// Sideways too: over the flank of an inclusion, on tissue whose stiffness grows with the depth.
TEST(Lift, OfAFingerThatSlidesOverAnInclusionLeavesNoForceInTheAir) {
  for (const DeviceProfile& device : devices())
    for (const std::string& name : renderer_names())
      for (const double lift_m_s : {0.1, 0.5}) {
        const double depth_m = 0.006;
        test::AnalyticTissue tissue;
        tissue.stiffness = device.largest_stiffness_n_m / (3 * 2.5 * std::sqrt(depth_m));
        const Felt felt = lift(name, device.limits(), tissue, {depth_m, lift_m_s, 0.03});
        const std::string what = device.name + ' ' + name + ' ' + std::to_string(lift_m_s) + " m/s";
        expect_nothing_in_the_air(felt, what);
        EXPECT_GT(felt.largest_n, 0.5) << what;
        EXPECT_GE(felt.end_energy_j, -0.05 * felt.stored_j - 0.005 * felt.largest_n * (lift_m_s + 0.05))
            << what;
      }
}

ForceChainInput pressed(double depth_m, double force_n) {
  return {.rendered = {.force_n = {0.6 * force_n, -0.8 * force_n, 0}},
          .pose = {{0.05, depth_m, 0}, Vector3::Zero()},
          .on = true,
          .enabled_s = 10};
}

// What takes the force away while the finger lifts: a fault, a pause, a force that is no number.
TEST(Lift, DuringAFadeIsSmoothAndLeavesNothing) {
  for (const bool paused : {true, false})
    for (const double lift_m_s : {0.0, 0.3, 0.6}) {
      ForceChainOptions options;
      ForceChain chain(options);
      for (int n = 0; n < 1000; ++n) chain.apply(pressed(0.008, 3));
      EXPECT_NEAR(chain.last_force_n().norm(), 3, 1e-9);
      double last_n = 3, last_m = 0.008;
      for (int n = 1; n <= 60; ++n) {
        ForceChainInput input = pressed(0.008 - lift_m_s * kTickS * n, 3);
        input.on = !paused;
        if (!paused) input.rendered.force_n.x() = std::nan("");
        const double depth_m = std::max(input.pose.position_m.y(), 0.0);
        const double force_n = chain.apply(input).force_n.norm();
        EXPECT_LE(force_n, last_n);
        EXPECT_LE(force_n, last_n * std::min(depth_m / last_m, 1.0) + 1e-12) << "no stiffer than before";
        const double slewed_n = std::max(last_n - options.limits.largest_slew_n_s * kTickS, 0.0);
        EXPECT_GE(force_n + 1e-12, std::min(slewed_n, last_n * depth_m / last_m)) << "no step";
        last_n = force_n;
        last_m = std::max(depth_m, 1e-12);
      }
      EXPECT_EQ(last_n, 0);
    }
}

// Fading for another reason when the link falls silent too, and the loop is held up past the end of it.
TEST(Lift, SilencePastItsLimitIsNoForceWhateverElseFades) {
  ForceChain chain{ForceChainOptions()};
  for (int n = 0; n < 1000; ++n) chain.apply(pressed(0.008, 3));
  ForceChainInput input = pressed(0.008, 3);
  input.on = false;
  EXPECT_GT(chain.apply(input).force_n.norm(), 2.5);
  input.silence_s = silence_limits(0).zero_s;
  input.dt_s = 0.1;
  EXPECT_EQ(chain.apply(input).force_n.norm(), 0);
}

TEST(ForceLimits, OnlyWhatRisesIsHeldBack) {
  const auto step = [](const Vector3& to, const Vector3& from) { return cap_rise(to, from, 0.1); };
  EXPECT_EQ(step({0, -1, 0}, {0, -3, 0}), Vector3(0, -1, 0));                     // falls at once
  EXPECT_EQ(step({0, 0, 0}, {2, -3, 0}), Vector3(0, 0, 0));                       // to nothing
  EXPECT_LE((step({0, -3, 0}, {0, -1, 0}) - Vector3(0, -1.1, 0)).norm(), 1e-12);  // rises by the slew
  EXPECT_LE((step({0, 3, 0}, {0, -1, 0}) - Vector3(0, 0.1, 0)).norm(),
            1e-12);  // turns: through nothing, then rises
  EXPECT_LE((step({3, 0, 0}, {3, -0.05, 0}) - Vector3(3, 0, 0)).norm(), 1e-12);  // sideways
  EXPECT_EQ(step({1, 1, 0}, {1, 1, 0}), Vector3(1, 1, 0));
  // From whatever to whatever: in the circle about the fall, widened by the slew.
  for (double angle = 0; angle < 6.3; angle += 0.1)
    for (const double magnitude_n : {0.1, 1.0, 5.0}) {
      const Vector3 from(0, -2, 0), to = magnitude_n * Vector3(std::cos(angle), std::sin(angle), 0);
      const Vector3 force_n = step(to, from);
      EXPECT_LE((force_n - from / 2).norm(), 1 + 0.1 + 1e-12);
      EXPECT_LE(force_n.norm(), std::max(from.norm(), to.norm()) + 1e-12);
    }
}

}  // namespace
}  // namespace teletact::client
