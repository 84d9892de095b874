// What real devices leave out or get wrong at first: a position that is no number, none yet, no velocity.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <string>

#include "client/haptic/anchor.h"
#include "client/haptic/derived_velocity.h"
#include "client/haptic/plugin_device.h"

namespace teletact::client {
namespace {

TEST(Anchor, IsTheFirstPointThatIsANumber) {
  Anchor anchor({0.03, -0.005});
  EXPECT_FALSE(anchor.to_scene({NAN, 0.2}).allFinite());
  EXPECT_FALSE(anchor.to_scene({0.1, INFINITY}).allFinite());
  EXPECT_FALSE(anchor.held());
  EXPECT_EQ(anchor.to_scene({0.1, 0.2}), Vector2(0.03, -0.005));
  EXPECT_LE((anchor.to_scene({0.11, 0.203}) - Vector2(0.04, -0.002)).norm(), 1e-15);
  EXPECT_FALSE(anchor.to_scene({NAN, 0}).allFinite());
  EXPECT_LE((anchor.to_scene({0.1, 0.2}) - Vector2(0.03, -0.005)).norm(), 1e-15);
}

// A finger at 50 mm/s whose position comes every `every` ticks, in steps of `step_m`.
Vector2 derived(DerivedVelocity& velocity, double seconds, int every, double step_m) {
  Vector2 found(0, 0), seen(0, 0);
  for (int n = 0; n < 1000 * seconds; ++n) {
    if (n % every == 0) seen.y() = step_m > 0 ? std::floor(5e-5 * n / step_m) * step_m : 5e-5 * n;
    found = velocity.at(seen, 1'000'000'000 + n * 1'000'000ll);
  }
  return found;
}

TEST(DerivedVelocity, IsTheFingersHoweverSeldomAndCoarseThePositionsAre) {
  for (const int every : {1, 10})
    for (const double step_m : {0.0, 2e-5}) {
      DerivedVelocity velocity;
      const Vector2 found = derived(velocity, 0.5, every, step_m);
      EXPECT_NEAR(found.y(), 0.05, step_m > 0 && every == 1 ? 0.011 : 0.003) << every << ' ' << step_m;
      EXPECT_EQ(found.x(), 0);
    }
}

TEST(DerivedVelocity, OfAFingerThatStopsGoesToNothingAndOfNoNumberThereIsNone) {
  DerivedVelocity velocity;
  derived(velocity, 0.5, 1, 0);
  const std::int64_t stopped_ns = 1'499'000'000;
  const Vector2 there(0, 5e-5 * 499);
  EXPECT_NEAR(velocity.at(there, stopped_ns).y(), 0.05, 1e-9);
  EXPECT_NEAR(velocity.at(there, stopped_ns + 10'000'000).y(), 0.005, 1e-9);
  EXPECT_LT(velocity.at(there, stopped_ns + 1'000'000'000).y(), 1e-4);
  EXPECT_EQ(velocity.at({NAN, 0}, stopped_ns + 1'001'000'000).norm(), 0);
  EXPECT_EQ(velocity.at({0, 0.3}, stopped_ns + 1'002'000'000).norm(), 0);  // a new beginning
}

// GIVEN an adapter whose device says nothing at first, then no number, and never a velocity WHEN it moves
// THEN the session begins where it is first read, and the velocity is the positions'.
TEST(PluginDevice, WaitsForAPositionAndDerivesTheVelocity) {
  PluginDevice device(std::string(std::getenv("TELETACT_BINARY_DIR")) + "/tests/plugin_slow_start.so", "",
                      {0.03, -0.005});
  device.open();
  DeviceReading reading;
  std::int64_t now_ns = 1'000'000'000;
  for (int n = 0; n < 5; ++n) EXPECT_FALSE(device.read(now_ns += 1'000'000, reading)) << n;
  ASSERT_TRUE(device.read(now_ns += 1'000'000, reading));
  EXPECT_FALSE(reading.pose.position_m.allFinite());
  ASSERT_TRUE(device.read(now_ns += 1'000'000, reading));
  EXPECT_EQ(reading.pose.position_m, Vector2(0.03, -0.005));
  for (int n = 1; n <= 20; ++n) ASSERT_TRUE(device.read(now_ns += 1'000'000, reading));
  EXPECT_NEAR(reading.pose.position_m.y(), -0.005 + 20 * 1e-4, 1e-12);  // 0.1 mm a read
  EXPECT_NEAR(reading.pose.velocity_m_s.y(), 0.1, 1e-9);
  EXPECT_EQ(reading.pose.velocity_m_s.x(), 0);
}

}  // namespace
}  // namespace teletact::client
