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

TEST(RobotArm, FramesAreTakenAtRestOnTheTicksOfTheScanner) {
  RobotArm arm({}, 0.0, 0.0);
  double at_m = 0;
  for (double begin : {0.0071, 1.0, 2.3456}) {
    const double way_m = (begin > 1 ? 0.06 : 0.12) - at_m;
    const ArmSchedule s = arm.acquire(at_m += way_m, 0.00045, begin);
    for (double frame : {s.pre_frame_s, s.post_frame_s})
      EXPECT_NEAR(frame * 50, std::round(frame * 50), 1e-9) << "not a tick of 50 Hz";
    EXPECT_GE(s.pre_frame_s, s.contact_s + 0.005 - 1e-9);
    EXPECT_GE(s.post_frame_s, s.compressed_s + 0.005 - 1e-9);
    EXPECT_NEAR(s.contact_s - s.begin_s, move_duration_s(way_m, 0.3, 3) + move_duration_s(0.002, 0.3, 3),
                1e-9);
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
