// Position-like displays: the coupling against closed forms, and its passivity with hands that dissipate
// nothing themselves.
#include "client/haptic/virtual_coupling.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "client/haptic/simulated_position_device.h"

namespace teletact::client {
namespace {

constexpr double kServoS = 0.001;

TEST(VirtualCoupling, ToolFollowsTheClosedFormUnderAPush) {
  VirtualCoupling coupling({.mass_kg = 0.25, .damping_n_s_m = 2}, {0.01, 0, 0});
  for (int n = 0; n < 300; ++n) coupling.step({0.5, 0, 0}, {0, -0.2, 0}, kServoS);
  const double tau_s = 0.125, t = 0.3, moved = t - tau_s * (1 - std::exp(-t / tau_s));
  EXPECT_NEAR(coupling.tool().position_m.x(), 0.01 + 0.25 * moved, 1e-12);
  EXPECT_NEAR(coupling.tool().position_m.y(), -0.1 * moved, 1e-12);
  EXPECT_NEAR(coupling.tool().velocity_m_s.x(), 0.25 * (1 - std::exp(-t / tau_s)), 1e-12);
}

TEST(VirtualCoupling, WithoutDampingIsRefused) {
  EXPECT_THROW(VirtualCoupling({.damping_n_s_m = 0}, {0, 0, 0}), std::invalid_argument);
  EXPECT_THROW(VirtualCoupling({.mass_kg = 0, .damping_n_s_m = 1}, {0, 0, 0}), std::invalid_argument);
}

TEST(VirtualCoupling, ForceThatIsNoNumberOnlySlowsTheTool) {
  VirtualCoupling coupling({.damping_n_s_m = 2}, {0, 0, 0});
  coupling.step({std::numeric_limits<double>::quiet_NaN(), 0, 0}, {0, 1, 0}, kServoS);
  EXPECT_EQ(coupling.tool().position_m.norm(), 0);
}

struct Pressed {
  double later_over_earlier = 0;  // swing of the arm in the sixth second over that in the third
  double min_work_j = 0;          // of the hand on the arm, in all
};

// A hand presses 4 mm into a spring as stiff as the device may render, and stays.
Pressed press(const HandOptions& held, double stiffness_n_m, double damping_share,
              double tool_mass_kg = VirtualCouplingOptions().mass_kg) {
  SimulatedPositionDeviceOptions options;
  options.profile = device_profile("premium-1.5");
  options.profile.largest_stiffness_n_m = stiffness_n_m;
  options.hand = held;
  options.hand.begin_m = options.hand.end_m = options.hand.start_m = 0.05;
  options.hand.depth_gain_1_s = 0;
  options.damping_share = damping_share;
  options.tool_mass_kg = tool_mass_kg;
  SimulatedPositionDevice device(options);
  device.open();
  const OperatorView felt{.force_on = true, .link_alive = true, .covered = true, .region = {.end_x_m = 0.1}};
  std::array<double, 6> low, high;
  low.fill(1e9);
  high.fill(-1e9);
  Pressed pressed;
  for (int n = 0; n < 6000; ++n) {
    DeviceReading reading;
    EXPECT_TRUE(device.read(1'000'000'000 + n * 1'000'000ll, reading));
    EXPECT_TRUE(device.write({0, -stiffness_n_m * std::max(reading.pose.position_m.y(), 0.0), 0}));
    device.show(felt);
    const double y_m = device.arm().position_m.y();
    low[n / 1000] = std::min(low[n / 1000], y_m);
    high[n / 1000] = std::max(high[n / 1000], y_m);
    pressed.min_work_j = std::min(pressed.min_work_j, device.hand_work_j());
  }
  pressed.later_over_earlier = (high[5] - low[5]) / std::max(high[2] - low[2], 1e-15);
  return pressed;
}

HandOptions hand(double mass_kg, double damping_n_s_m, double stiffness_n_m) {
  HandOptions options;
  options.mass_kg = mass_kg;
  options.damping_n_s_m = damping_n_s_m;
  options.stiffness_n_m = stiffness_n_m;
  return options;
}

TEST(VirtualCoupling, LosslessHandComesToRestAtTheCap) {
  for (const double stiffness_n_m : {100.0, 400.0, 800.0, 1000.0})
    for (const double mass_kg : {0.01, 0.05, 0.2})
      for (const double hand_n_m : {200.0, 1000.0})
        EXPECT_LT(press(hand(mass_kg, 0, hand_n_m), stiffness_n_m, 1).later_over_earlier, 0.9)
            << stiffness_n_m << " N/m, hand " << mass_kg << " kg " << hand_n_m << " N/m";
}

TEST(VirtualCoupling, FourFifthsOfThatDampingIsTooLittle) {
  for (const double stiffness_n_m : {400.0, 800.0})
    EXPECT_GT(press(hand(0.01, 0, 1000), stiffness_n_m, 0.8).later_over_earlier, 1);
}

TEST(VirtualCoupling, NoHandGetsBackMoreThanItPutIn) {
  for (const auto& held : {hand(0.01, 2, 200), hand(0.1, 5, 500), hand(0.2, 10, 1000), hand(0.2, 2, 1000),
                           hand(0.01, 2, 1000)}) {
    const Pressed pressed = press(held, 800, 1);
    EXPECT_LT(pressed.later_over_earlier, 0.01);
    EXPECT_GE(pressed.min_work_j, -1e-6);
  }
}

TEST(SimulatedPositionDevice, CountsOnSpareDampingAndNoFriction) {
  SimulatedPositionDeviceOptions options;
  options.profile = device_profile("omni");
  EXPECT_GT(options.profile.friction_n, 0);
  const ForceLimits limits = SimulatedPositionDevice(options).profile().limits();
  EXPECT_EQ(limits.friction_n, 0);
  EXPECT_NEAR(limits.damping_n_s_m, 700 * 0.001 / 2, 1e-12);  // (T5.1) for the tissue at the cap
}

TEST(VirtualCoupling, ToolUnderHalfTheHandsMassShakes) {
  EXPECT_GT(press(hand(0.2, 2, 500), 400, 1, 0.09).later_over_earlier, 1);
  EXPECT_LT(press(hand(0.2, 2, 500), 400, 1, 0.15).later_over_earlier, 0.01);
}

}  // namespace
}  // namespace teletact::client
