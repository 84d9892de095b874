#include "client/haptic/simulated_device.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/render/analytic_tissue.h"

namespace teletact::client {
namespace {

SimulatedDeviceOptions options() {
  SimulatedDeviceOptions options;
  options.profile = device_profile("premium-1.5");
  options.hand.begin_m = options.hand.start_m = 0.01;
  options.hand.end_m = 0.11;
  return options;
}

OperatorView felt() {
  return {.force_on = true, .link_alive = true, .covered = true, .region = {.end_x_m = 0.12}};
}

// Runs the device against tissue at 1 kHz; `each(t, reading)` sees every tick.
template <typename Each>
void play(SimulatedDevice& device, const OperatorView& view, double seconds, Each&& each) {
  const test::AnalyticTissue tissue;
  static std::int64_t now_ns = 1'000'000'000;
  for (int n = 0; n < seconds * 1000; ++n, now_ns += 1'000'000) {
    DeviceReading reading;
    ASSERT_TRUE(device.read(now_ns, reading));
    ASSERT_TRUE(device.write(tissue.answer(device.exact().position_m).force_n));
    device.show(view);
    each(0.001 * n, reading);
  }
}

TEST(DeviceProfiles, AreThoseOfT57) {
  const DeviceProfile& premium = device_profile("premium-1.5");
  EXPECT_EQ(premium.largest_force_n, 8.5);
  EXPECT_EQ(premium.largest_stiffness_n_m, 800);
  const ForceLimits limits = premium.limits();  // as the safety chain gets them
  EXPECT_EQ(limits.largest_force_n, 8.5);
  EXPECT_EQ(limits.largest_stiffness_n_m, 800);
  EXPECT_EQ(limits.largest_damping_n_s_m, 5);
  EXPECT_EQ(limits.largest_slew_n_s, 0.15 * 800);
  EXPECT_EQ(limits.friction_n, 0.04);
  EXPECT_EQ(device_profile("touch").largest_damping_n_s_m, 4);
  EXPECT_THROW(device_profile("spoon"), std::invalid_argument);
}

TEST(SimulatedDevice, SweepsToAndFroAtTheSpeedAndDepthAskedFor) {
  SimulatedDevice device(options());
  device.open();
  double depth_sum = 0, fastest = 0, smallest_x = 1, largest_x = 0;
  int ticks = 0;
  play(device, felt(), 8, [&](double t, const DeviceReading& reading) {
    fastest = std::max(fastest, std::abs(device.exact().velocity_m_s.x()));
    if (t < 3) return;
    depth_sum += device.exact().position_m.y();
    ++ticks;
    smallest_x = std::min(smallest_x, reading.pose.position_m.x());
    largest_x = std::max(largest_x, reading.pose.position_m.x());
    EXPECT_FALSE(reading.held_at_border);
  });
  EXPECT_NEAR(depth_sum / ticks, 0.004, 0.0003);
  EXPECT_NEAR(fastest, 0.14, 0.025);  // an inclusion's lateral force hurries the finger off it
  EXPECT_NEAR(smallest_x, 0.01, 0.003);
  EXPECT_NEAR(largest_x, 0.11, 0.003);
  // 100 mm at 120 mm/s plus a rounded turn of 0.12 s.
  EXPECT_NEAR(device.hand().passes(), 7, 1);
}

// From its pressing on, the hand's own way: what the device does of it is the tests' beside this.
std::vector<Vector3> way_of(const HandOptions& options, double seconds, const Region& region) {
  Hand hand(options);
  OperatorView view = felt();
  view.region = region;
  std::vector<Vector3> way;
  Vector3 at = hand.target_m();
  for (int n = 0; n < seconds * 1000; ++n) {
    hand.intend(view, at, 0.001);
    at = hand.target_m();
    way.push_back(at);
  }
  return way;
}

TEST(Hand, GoesInCirclesAboutAPointThatSweeps) {
  HandOptions options;
  options.begin_m = options.start_m = 0.02, options.end_m = 0.09;
  options.across_m = 0.003, options.circle_radius_m = 0.006, options.speed_m_s = 0.05;
  const std::vector<Vector3> way = way_of(options, 9, {.end_x_m = 0.12, .begin_z_m = -0.02, .end_z_m = 0.02});
  double min_z = 1, largest_z = -1, furthest_x = 0;
  unsigned crossings = 0;
  for (std::size_t n = 1000; n < way.size(); ++n) {
    EXPECT_NEAR((way[n] - way[n - 1]).norm(), 0.05e-3, 0.002e-3) << "the finger's speed, not the point's";
    min_z = std::min(min_z, way[n].z()), largest_z = std::max(largest_z, way[n].z());
    furthest_x = std::max(furthest_x, way[n].x());
    crossings += way[n - 1].z() < 0.003 && way[n].z() >= 0.003;
  }
  EXPECT_NEAR(min_z, -0.003, 1e-5);
  EXPECT_NEAR(largest_z, 0.009, 1e-5);
  // 8 s at 50 mm/s are 400 mm; a turn is about 40 mm long and goes on by 6 mm.
  EXPECT_NEAR(crossings, 10, 1);
  EXPECT_NEAR(furthest_x, 0.02 + 10 * 0.006 + 0.006, 0.009);
}

TEST(Hand, SweepsAlongZAndIsHeldAtItsBorder) {
  HandOptions options;
  options.along_z = true, options.across_m = 0.05;
  options.begin_m = options.start_m = -0.02, options.end_m = 0.02;
  const Region all{.end_x_m = 0.12, .begin_z_m = -0.03, .end_z_m = 0.03};
  double furthest = -1;
  for (const Vector3& at : way_of(options, 2, all)) {
    EXPECT_EQ(at.x(), 0.05);
    furthest = std::max(furthest, at.z());
  }
  EXPECT_EQ(furthest, 0.02);
  Region some = all;
  some.end_z_m = 0.01;
  EXPECT_NEAR(way_of(options, 2, some).back().z(), 0.009, 1e-5);
}

TEST(SimulatedDevice, InclusionsLiftTheFinger) {
  SimulatedDevice device(options());
  device.open();
  double shallowest = 1, deepest = 0;
  play(device, felt(), 6, [&](double t, const DeviceReading&) {
    if (t < 3) return;
    shallowest = std::min(shallowest, device.exact().position_m.y());
    deepest = std::max(deepest, device.exact().position_m.y());
  });
  EXPECT_GT(deepest - shallowest, 0.0005);
}

TEST(SimulatedDevice, IsHeldAtTheBorderUntilItGrows) {
  SimulatedDevice device(options());
  device.open();
  OperatorView view = felt();
  view.region.end_x_m = 0.06;
  bool held = false;
  double largest_x = 0;
  play(device, view, 3, [&](double, const DeviceReading& reading) {
    held = reading.held_at_border;
    largest_x = std::max(largest_x, device.exact().position_m.x());
  });
  EXPECT_TRUE(held);
  EXPECT_LE(largest_x, 0.06);
  EXPECT_NEAR(largest_x, 0.059, 0.001);
  view.region.end_x_m = 0.12;
  play(device, view, 0.5, [&](double, const DeviceReading& reading) { held = reading.held_at_border; });
  EXPECT_FALSE(held);
  EXPECT_GT(device.exact().position_m.x(), 0.07);
}

TEST(SimulatedDevice, LiftsWhenForceIsGoneAndAsksForItOutOfContact) {
  SimulatedDevice device(options());
  device.open();
  play(device, felt(), 1, [](double, const DeviceReading&) {});
  EXPECT_GT(device.exact().position_m.y(), 0.002);
  OperatorView view = felt();
  view.force_on = false;
  view.link_alive = false;
  bool pressed = false;
  play(device, view, 1, [&](double, const DeviceReading& reading) { pressed |= reading.resume_pressed; });
  EXPECT_LT(device.exact().position_m.y(), -0.002);
  EXPECT_FALSE(pressed);  // nobody answers yet
  view.link_alive = true;
  bool in_contact = false;
  play(device, view, 0.1, [&](double, const DeviceReading& reading) {
    pressed |= reading.resume_pressed;
    in_contact |= reading.resume_pressed && reading.pose.position_m.y() > 0;
  });
  EXPECT_TRUE(pressed);
  EXPECT_FALSE(in_contact);
}

TEST(SimulatedDevice, LimitsStateItsOwnDamping) {
  SimulatedDeviceOptions options;
  options.profile = device_profile("premium-1.5");
  EXPECT_EQ(options.profile.limits().damping_n_s_m, 0);
  options.damping_n_s_m = 0.7;
  EXPECT_EQ(SimulatedDevice(options).profile().limits().damping_n_s_m, 0.7);
}

TEST(SimulatedDevice, ReadsInStepsOfItsResolution) {
  SimulatedDevice device(options());
  device.open();
  play(device, felt(), 1, [](double, const DeviceReading& reading) {
    const Vector3 steps = reading.pose.position_m / 0.03e-3;
    EXPECT_NEAR(steps.x(), std::round(steps.x()), 1e-6);
    EXPECT_NEAR(steps.y(), std::round(steps.y()), 1e-6);
  });
}

TEST(SimulatedDevice, LosesEnergyWhenLeftAlone) {
  // GIVEN the hand's spring alone, stretched; WHEN time passes; THEN kinetic plus spring energy never grows.
  SimulatedDeviceOptions alone = options();
  SimulatedDevice device(alone);
  device.open();
  OperatorView view;
  view.surface.offset_m = 0;  // hovering: the target stands still
  device.show(view);
  DeviceReading reading;
  std::int64_t now_ns = 1;
  device.read(now_ns, reading);
  device.write(Vector3(1.0, -2.0, 0));
  for (int n = 0; n < 300; ++n) device.read(now_ns += 1'000'000, reading);
  device.write(Vector3::Zero());
  const auto energy = [&] {
    const Vector3 stretch = device.hand().target_m() - device.exact().position_m;
    return device.kinetic_energy_j() + 0.5 * alone.hand.stiffness_n_m * stretch.squaredNorm();
  };
  double last = energy();
  const double first = last;
  EXPECT_GT(first, 1e-3);
  for (int n = 0; n < 1000; ++n) {
    device.read(now_ns += 1'000'000, reading);
    EXPECT_LE(energy(), last + 1e-6 * first) << n;
    last = energy();
  }
  EXPECT_LE(last, 1e-3 * first);
}

TEST(SimulatedDevice, FrictionHoldsAgainstLessThanItself) {
  SimulatedDeviceOptions heavy = options();
  heavy.profile.friction_n = 0.26;
  SimulatedDevice device(heavy);
  device.open();
  DeviceReading reading;
  std::int64_t now_ns = 1;
  device.read(now_ns, reading);
  device.write(Vector3(0.25, 0, 0));
  for (int n = 0; n < 100; ++n) device.read(now_ns += 1'000'000, reading);
  EXPECT_EQ(device.exact().velocity_m_s.norm(), 0);
}

TEST(SimulatedDevice, RefusesWhatIsNoNumberAndLimitsTheRest) {
  SimulatedDevice device(options());
  EXPECT_FALSE(device.write(Vector3(0, 0, 0)));  // not open
  device.open();
  EXPECT_FALSE(device.write(Vector3(NAN, 0, 0)));
  EXPECT_TRUE(device.write(Vector3(1e9, 0, 0)));
  DeviceReading reading;
  std::int64_t now_ns = 1;
  device.read(now_ns, reading);
  device.read(now_ns += 1'000'000, reading);
  // 8.5 N on 0.175 kg for 1 ms
  EXPECT_LE(device.exact().velocity_m_s.x(), 8.5 / 0.175 * 0.001);
  EXPECT_GT(device.exact().velocity_m_s.x(), 0.9 * 8.5 / 0.175 * 0.001);
}

}  // namespace
}  // namespace teletact::client
