#include "client/acquire/robot_arm.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace teletact::client {
namespace {

TEST(RobotArm, MoveTimesAreThoseOfTheTrapezoid) {
  EXPECT_NEAR(move_duration_s(0.060, 0.3, 3), 0.06 / 0.3 + 0.1, 1e-12);
  EXPECT_NEAR(move_duration_s(-0.060, 0.3, 3), 0.3, 1e-12);
  EXPECT_NEAR(move_duration_s(0.002, 0.3, 3), 2 * std::sqrt(0.002 / 3), 1e-12);  // never reaches full speed
  EXPECT_NEAR(move_duration_s(0.03, 0.3, 3), 0.2, 1e-12);                        // exactly touches it
  EXPECT_EQ(move_duration_s(0, 0.3, 3), 0);
}

TEST(RobotArm, KeepsItsSpeedAndAccelerationLimits) {
  const ArmLimits limits;
  RobotArm arm(limits, 0.12, 0);
  const ArmSchedule schedule = arm.acquire(0.18, 0.00045, 0.013);
  const double dt = 1e-4;
  double speed_before_x = 0, speed_before_y = 0, top_speed = 0, top_acceleration = 0;
  ArmPose before = arm.pose(0);
  for (double t = dt; t < schedule.lifted_s + 0.01; t += dt) {
    const ArmPose now = arm.pose(t);
    const double vx = (now.window_x_m - before.window_x_m) / dt, vy = (now.depth_m - before.depth_m) / dt;
    top_speed = std::max({top_speed, std::abs(vx), std::abs(vy)});
    top_acceleration =
        std::max({top_acceleration, std::abs(vx - speed_before_x) / dt, std::abs(vy - speed_before_y) / dt});
    speed_before_x = vx, speed_before_y = vy, before = now;
  }
  EXPECT_LE(top_speed, limits.speed_m_s * (1 + 1e-6));
  EXPECT_LE(top_acceleration, limits.acceleration_m_s2 * (1 + 1e-4));
  EXPECT_GE(top_speed, limits.speed_m_s * 0.99) << "a 60 mm move should use the speed it has";
  EXPECT_NEAR(before.window_x_m, 0.18, 1e-12);
  EXPECT_NEAR(before.depth_m, -limits.lift_m, 1e-12);
}

TEST(RobotArm, MovesSidewaysOnlyWhenLifted) {
  RobotArm arm({}, 0.0, 0);
  const ArmSchedule schedule = arm.acquire(0.06, 0.0005, 0);
  ArmPose before = arm.pose(0);
  for (double t = 5e-4; t < schedule.lifted_s; t += 5e-4) {
    const ArmPose now = arm.pose(t);
    if (std::abs(now.window_x_m - before.window_x_m) > 1e-12) {
      EXPECT_NEAR(now.depth_m, -0.002, 1e-12) << t;
    }
    before = now;
  }
}

TEST(RobotArm, FramesAreTakenAtRestOnTheTicksOfTheScanner) {
  RobotArm arm({}, 0.0, 0.0);
  for (double begin : {0.0071, 1.0, 2.3456}) {
    const ArmSchedule s = arm.acquire(begin > 1 ? 0.06 : 0.12, 0.00045, begin);
    for (double frame : {s.pre_frame_s, s.post_frame_s})
      EXPECT_NEAR(frame * 50, std::round(frame * 50), 1e-9) << "not a tick of 50 Hz";
    EXPECT_GE(s.pre_frame_s, s.contact_s + 0.005 - 1e-9);
    EXPECT_GE(s.post_frame_s, s.compressed_s + 0.005 - 1e-9);
    EXPECT_NEAR(arm.pose(s.pre_frame_s).depth_m, 0, 1e-12);
    EXPECT_NEAR(arm.pose(s.post_frame_s).depth_m, 0.00045, 1e-12);
  }
}

TEST(RobotArm, MakesAdjacentWindowsFasterThanTheFingerCrossesThem) {
  RobotArm arm({}, 0.0, 0.0);
  double free_s = arm.acquire(0.0, 0.0005, 0).lifted_s;
  double longest = 0;
  for (int k = 1; k < 40; ++k) {
    const double lifted = arm.acquire(0.06 * (k % 5), 0.0005, free_s).lifted_s;
    if (k % 5) longest = std::max(longest, lifted - free_s);
    free_s = lifted;
  }
  EXPECT_LE(longest, 0.060 / 0.120);  // (T1)
  EXPECT_GT(longest, 0.4);            // and it does take time
}

TEST(RobotArm, AnOrderGivenWhileItMovesWaits) {
  RobotArm arm({}, 0.0, 0.0);
  const ArmSchedule first = arm.acquire(0.06, 0.0005, 0.0);
  const ArmSchedule second = arm.acquire(0.12, 0.0005, 0.01);
  EXPECT_NEAR(second.begin_s, first.lifted_s, 1e-12);
}

TEST(RobotArm, RefusesWhatIsNotAMove) {
  RobotArm arm({}, 0.0, 0.0);
  EXPECT_THROW(arm.acquire(0.06, 0.0, 0.0), std::invalid_argument);
  EXPECT_THROW(arm.acquire(0.06, std::numeric_limits<double>::quiet_NaN(), 0.0), std::invalid_argument);
  ArmLimits still;
  still.speed_m_s = 0;
  EXPECT_THROW(RobotArm(still, 0, 0), std::invalid_argument);
}

}  // namespace
}  // namespace teletact::client
