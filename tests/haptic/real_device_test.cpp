// What real devices leave out or get wrong at first: a position that is no number, none yet, no velocity.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <string>

#include "client/haptic/anchor.h"
#include "client/haptic/derived_velocity.h"
#include "client/haptic/plugin_device.h"

namespace teletact::client {
namespace {

TEST(Anchor, IsTheFirstPointThatIsANumber) {
  Anchor anchor({0.03, -0.005, 0});
  EXPECT_FALSE(anchor.to_scene({NAN, 0.2, 0}).allFinite());
  EXPECT_FALSE(anchor.to_scene({0.1, INFINITY, 0}).allFinite());
  EXPECT_FALSE(anchor.held());
  EXPECT_EQ(anchor.to_scene({0.1, 0.2, 0}), Vector3(0.03, -0.005, 0));
  EXPECT_LE((anchor.to_scene({0.11, 0.203, 0}) - Vector3(0.04, -0.002, 0)).norm(), 1e-15);
  EXPECT_FALSE(anchor.to_scene({NAN, 0, 0}).allFinite());
  EXPECT_LE((anchor.to_scene({0.1, 0.2, 0}) - Vector3(0.03, -0.005, 0)).norm(), 1e-15);
}

// A finger at 50 mm/s whose position comes every `every` ticks, in steps of `step_m`.
Vector3 derived(DerivedVelocity& velocity, double seconds, int every, double step_m) {
  Vector3 found(0, 0, 0), seen(0, 0, 0);
  for (int n = 0; n < 1000 * seconds; ++n) {
    if (n % every == 0) seen.y() = step_m > 0 ? std::floor(5e-5 * n / step_m) * step_m : 5e-5 * n;
    found = velocity.at(seen, 1'000'000'000 + n * 1'000'000ll);
  }
  return found;
}

TEST(DerivedVelocity, FollowsSeldomAndCoarsePositions) {
  for (const int every : {1, 10})
    for (const double step_m : {0.0, 2e-5}) {
      DerivedVelocity velocity;
      const Vector3 found = derived(velocity, 0.5, every, step_m);
      EXPECT_NEAR(found.y(), 0.05, step_m > 0 && every == 1 ? 0.006 : 0.003) << every << ' ' << step_m;
      EXPECT_EQ(found.x(), 0);
    }
}

TEST(DerivedVelocity, EndsWithTheMotionAndAtNoNumber) {
  DerivedVelocity velocity;
  derived(velocity, 0.5, 1, 0);
  const std::int64_t stopped_ns = 1'499'000'000;
  const Vector3 there(0, 5e-5 * 499, 0);
  EXPECT_NEAR(velocity.at(there, stopped_ns).y(), 0.05, 1e-9);
  EXPECT_NEAR(velocity.at(there, stopped_ns + 10'000'000).y(), 0.005, 1e-9);
  EXPECT_LT(velocity.at(there, stopped_ns + 1'000'000'000).y(), 1e-4);
  EXPECT_EQ(velocity.at({NAN, 0, 0}, stopped_ns + 1'001'000'000).norm(), 0);
  EXPECT_EQ(velocity.at({0, 0.3, 0}, stopped_ns + 1'002'000'000).norm(), 0);  // a new beginning
}

// A device that is sampled once a millisecond, in steps of `step_m`, and read at uneven times: a tick 0.8 ms
// late is followed by one that is on time. Returns the largest speed found by `end_s`.
double largest_m_s(DerivedVelocity& velocity, const std::function<double(double)>& at_m, double step_m,
                   double end_s, double* passes_1_m_s_after_s = nullptr) {
  double largest_m_s = 0;
  for (int n = 0; n < 1000 * end_s; ++n) {
    const double read_s = 1e-3 * (n + (n % 3 == 1 ? 0.8 : 0));
    const double sampled_s = 1e-3 * std::floor(1e3 * read_s + 0.1);
    const double position_m = step_m * std::floor(at_m(sampled_s) / step_m);
    const std::int64_t now_ns = 1'000'000'000 + std::llround(1e9 * read_s);
    const double found_m_s = velocity.at({0, position_m, 0}, now_ns).norm();
    if (passes_1_m_s_after_s != nullptr && largest_m_s <= 1 && found_m_s > 1) *passes_1_m_s_after_s = read_s;
    largest_m_s = std::max(largest_m_s, found_m_s);
  }
  return largest_m_s;
}

TEST(DerivedVelocity, OfUnevenTicksAndSuddenStepsIsNoRunaway) {
  for (const double step_m : {1e-7, 5.5e-5})
    for (const double speed_m_s : {0.03, 0.3}) {
      DerivedVelocity velocity;
      const double largest = largest_m_s(
          velocity, [&](double t_s) { return speed_m_s * t_s; }, step_m, 0.5);
      EXPECT_LT(largest, 1.25 * speed_m_s + step_m / DerivedVelocity::kWindowS + 1e-6) << speed_m_s;
      EXPECT_GT(largest, 0.9 * speed_m_s);
    }
  // An encoder between two of its steps, read twice within 50 us.
  DerivedVelocity velocity;
  for (int n = 0; n < 200; ++n) {
    const std::int64_t now_ns = 1'000'000'000 + (n / 2) * 1'000'000ll + (n % 2) * 50'000;
    EXPECT_LT(velocity.at({0, n % 2 * 5.5e-5, 0}, now_ns).norm(), 0.05) << n;
  }
}

TEST(DerivedVelocity, OfARunawayIsSeenSoon) {
  for (const double rests_s : {0.0, 0.1, 1.0})
    for (const double before_m_s : {0.0, 0.1}) {
      DerivedVelocity velocity;
      double seen_s = 1e9;
      largest_m_s(
          velocity,
          [&](double t_s) {
            return before_m_s * std::min(t_s, rests_s) + 1.5 * std::max(t_s - rests_s, 0.0);
          },
          5.5e-5, rests_s + 0.1, &seen_s);
      EXPECT_LE(seen_s - rests_s, 0.010) << rests_s << ' ' << before_m_s;
    }
}

// GIVEN an adapter whose device says nothing at first, then no number, and never a velocity WHEN it moves
// THEN the session begins where it is first read, and the velocity is the positions'.
TEST(PluginDevice, WaitsForAPositionAndDerivesTheVelocity) {
  PluginDevice device(std::string(std::getenv("TELETACT_BINARY_DIR")) + "/tests/plugin_slow_start.so", "",
                      {0.03, -0.005, 0});
  device.open();
  DeviceReading reading;
  std::int64_t now_ns = 1'000'000'000;
  for (int n = 0; n < 5; ++n) EXPECT_FALSE(device.read(now_ns += 1'000'000, reading)) << n;
  ASSERT_TRUE(device.read(now_ns += 1'000'000, reading));
  EXPECT_FALSE(reading.pose.position_m.allFinite());
  ASSERT_TRUE(device.read(now_ns += 1'000'000, reading));
  EXPECT_EQ(reading.pose.position_m, Vector3(0.03, -0.005, 0));
  for (int n = 1; n <= 20; ++n) ASSERT_TRUE(device.read(now_ns += 1'000'000, reading));
  EXPECT_NEAR(reading.pose.position_m.y(), -0.005 + 20 * 1e-4, 1e-12);  // 0.1 mm a read
  EXPECT_NEAR(reading.pose.velocity_m_s.y(), 0.1, 1e-9);
  EXPECT_EQ(reading.pose.velocity_m_s.x(), 0);
}

}  // namespace
}  // namespace teletact::client
