#include "client/haptic/replay_device.h"

#include <gtest/gtest.h>

#include <cmath>

namespace teletact::client {
namespace {

// A dip of 4 mm within 1 s, recorded every 10 ms with a clock that started elsewhere.
std::vector<MotionPoint> dip() {
  std::vector<MotionPoint> motion;
  for (int k = 0; k <= 100; ++k) {
    MotionPoint point;
    point.time_s = 777 + 0.01 * k;
    point.pose.position_m = {0.02 + 0.0001 * k, -0.001 + 0.005 * std::sin(M_PI * 0.01 * k), 0};
    point.pose.velocity_m_s = {0.01, 0.005 * M_PI * std::cos(M_PI * 0.01 * k), 0};
    motion.push_back(point);
  }
  return motion;
}

TEST(ReplayDevice, WaitsForForceThenDoesTheMotionAgain) {
  ReplayDevice device(device_profile("omni"), dip());
  DeviceReading reading;
  EXPECT_FALSE(device.read(1, reading));
  device.open();
  // GIVEN no force yet THEN it hovers where the motion begins, and asks once answers flow
  std::int64_t now_ns = 5'000'000'000;
  ASSERT_TRUE(device.read(now_ns, reading));
  EXPECT_EQ(reading.pose.position_m, Vector3(0.02, -0.001, 0));
  EXPECT_FALSE(reading.resume_pressed);
  device.show({.link_alive = true});
  ASSERT_TRUE(device.read(now_ns += 300'000'000, reading));
  EXPECT_TRUE(reading.resume_pressed);
  EXPECT_EQ(reading.pose.position_m, Vector3(0.02, -0.001, 0));
  EXPECT_EQ(reading.pose.velocity_m_s.norm(), 0);
  // WHEN force is on THEN the motion passes at its own speed, between its points too
  device.show({.force_on = true, .link_alive = true});
  const std::int64_t begin_ns = now_ns + 1'000'000;
  for (int n = 0; n <= 999; ++n) {
    ASSERT_TRUE(device.read(begin_ns + n * 1'000'000, reading));
    const double t = 0.001 * n;
    EXPECT_NEAR(reading.pose.position_m.y(), -0.001 + 0.005 * std::sin(M_PI * t), 1e-6);
    EXPECT_NEAR(reading.pose.position_m.x(), 0.02 + 0.01 * t, 1e-9);
    EXPECT_NEAR(reading.pose.velocity_m_s.y(), 0.005 * M_PI * std::cos(M_PI * t), 1e-4);
    EXPECT_FALSE(device.ended());
    EXPECT_TRUE(device.write({0, -1, 0}));
  }
  // THEN it stays where it ended, and says so
  ASSERT_TRUE(device.read(begin_ns + 1'000'000'001, reading));
  EXPECT_TRUE(device.ended());
  EXPECT_NEAR(reading.pose.position_m.y(), -0.001, 1e-9);
  EXPECT_EQ(reading.pose.velocity_m_s.norm(), 0);
}

TEST(ReplayDevice, TakesNoMotionThatIsNone) {
  const DeviceProfile& profile = device_profile("omni");
  EXPECT_THROW(ReplayDevice(profile, {}), std::invalid_argument);
  EXPECT_THROW(ReplayDevice(profile, {MotionPoint()}), std::invalid_argument);
  auto backwards = dip();
  backwards[3].time_s = 0;
  EXPECT_THROW(ReplayDevice(profile, backwards), std::invalid_argument);
  auto no_number = dip();
  no_number[5].pose.position_m.x() = NAN;
  EXPECT_THROW(ReplayDevice(profile, no_number), std::invalid_argument);
}

}  // namespace
}  // namespace teletact::client
