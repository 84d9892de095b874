#include "client/acquire/window_planner.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "client/acquire/robot_arm.h"

namespace teletact::client {
namespace {

PlannerOptions five_windows() {
  PlannerOptions options;
  options.window_count = 5;
  return options;
}

std::vector<WindowKnowledge> unknown(std::size_t count) {
  return std::vector<WindowKnowledge>(count, {{}, 100});
}

TEST(WindowPlanner, TakesTheFingersOwnWindowFirstThenThoseAhead) {
  WindowPlanner planner(five_windows(), 0.15, +1);
  auto windows = unknown(5);
  const FingerMotion finger{true, 0.15, 0.12};
  for (std::size_t expected : {2u, 3u, 4u}) {
    const auto next = planner.next(finger, windows, 0.0);
    ASSERT_TRUE(next);
    EXPECT_EQ(*next, expected);
    windows[*next].acquired_s = 0.0;
  }
  EXPECT_FALSE(planner.next(finger, windows, 0.5));  // what lies behind is not asked for
}

TEST(WindowPlanner, KeepsTheDirectionWhileTheFingerRests) {
  WindowPlanner planner(five_windows(), 0.15, +1);
  auto windows = unknown(5);
  windows[2].acquired_s = 0.0;
  EXPECT_EQ(planner.next({true, 0.15, -0.12}, windows, 0.0), 1u);
  for (const double noise_m_s : {0.0, 0.001, -0.001, 0.009})
    EXPECT_EQ(planner.next({true, 0.15, noise_m_s}, windows, 0.0), 1u) << noise_m_s;
  EXPECT_EQ(planner.next({true, 0.15, 0.12}, windows, 0.0), 3u);
}

TEST(WindowPlanner, PreparesTheStartAndWaitsForAFinger) {
  WindowPlanner planner(five_windows(), 0.03, +1);
  auto windows = unknown(5);
  for (std::size_t expected : {0u, 1u, 2u}) {
    const auto next = planner.next({}, windows, 0.0);
    ASSERT_TRUE(next);
    EXPECT_EQ(*next, expected);
    windows[*next].acquired_s = 0.0;
  }
  EXPECT_FALSE(planner.next({}, windows, 1000.0));
}

TEST(WindowPlanner, TakesAllWhereItIsToldTo) {
  PlannerOptions options = five_windows();
  options.all = true, options.lookahead = 1;
  WindowPlanner planner(options, 0.15, +1);
  auto windows = unknown(5);
  windows[0].frames_left = 0;
  for (const std::size_t expected : {2u, 3u, 1u, 4u}) {
    const auto next = planner.next({}, windows, 0.0);
    ASSERT_TRUE(next);
    EXPECT_EQ(*next, expected);
    windows[*next].acquired_s = 0.0;
  }
  EXPECT_FALSE(planner.next({}, windows, 0.0));
}

TEST(WindowPlanner, UnknownComesBeforeStale) {
  WindowPlanner planner(five_windows(), 0.03, +1);
  auto windows = unknown(5);
  windows[0].acquired_s = windows[1].acquired_s = 0.0;
  EXPECT_EQ(planner.next({true, 0.03, 0.12}, windows, 10.0), 2u);
  windows[2].acquired_s = 10.0;
  // Windows 3 and 4 lie beyond the lookahead, but a renewal would delay them.
  EXPECT_FALSE(planner.next({true, 0.03, 0.12}, windows, 10.0));
  windows[3].acquired_s = windows[4].acquired_s = 10.0;
  EXPECT_EQ(planner.next({true, 0.03, 0.02}, windows, 10.0), 1u);
}

TEST(WindowPlanner, RenewsOnlyWhatIsReadyBeforeTheFingerArrives) {
  WindowPlanner planner(five_windows(), 0.27, +1);
  auto windows = unknown(5);
  for (auto& window : windows) window.acquired_s = 0.0;
  EXPECT_FALSE(planner.next({true, 0.27, 0.12}, windows, 100.0));  // its own window is left alone
  // At 120 mm/s window 3 is 0.33 s away from x = 0.14, window 4 0.83 s.
  EXPECT_EQ(planner.next({true, 0.14, 0.12}, windows, 100.0), 4u);
  EXPECT_FALSE(planner.next({true, 0.19, 0.12}, windows, 100.0));
  EXPECT_EQ(planner.next({true, 0.16, -0.12}, windows, 100.0), 0u);
}

TEST(WindowPlanner, WhatIsWishedComesFirstIfItIsNotKnownAndFresh) {
  WindowPlanner planner(five_windows(), 0.03, +1);
  auto windows = unknown(5);
  const FingerMotion finger{true, 0.03, 0.12, 0.27};
  EXPECT_EQ(planner.next(finger, windows, 0.0), 4u);
  EXPECT_EQ(planner.next({false, 0, 0, 0.27}, windows, 0.0), 4u) << "a finger that is not told";
  windows[4].acquired_s = 0.0;
  EXPECT_EQ(planner.next(finger, windows, 0.5), 0u) << "it is there, or under way";
  EXPECT_EQ(planner.next(finger, windows, 1.5), 4u) << "it is stale";
  windows[4].frames_left = 0;
  EXPECT_EQ(planner.next(finger, windows, 1.5), 0u);
}

TEST(WindowPlanner, AsksForNothingThatTheSourceCannotDeliver) {
  WindowPlanner planner(five_windows(), 0.03, +1);
  auto windows = unknown(5);
  windows[0].frames_left = 0;
  EXPECT_EQ(planner.next({true, 0.03, 0.12}, windows, 0.0), 1u);
}

TEST(WindowPlanner, FingersOutsideTheTissueBelongToTheOuterWindows) {
  const WindowPlanner planner(five_windows(), 0, 1);
  EXPECT_EQ(planner.window_at(-1.0), 0u);
  EXPECT_EQ(planner.window_at(0.0599), 0u);
  EXPECT_EQ(planner.window_at(0.06), 1u);
  EXPECT_EQ(planner.window_at(0.3), 4u);
  EXPECT_EQ(planner.window_at(7.0), 4u);
}

TEST(WindowPlanner, RefusesATissueWithoutWindows) {
  PlannerOptions none;
  none.window_count = 0;
  EXPECT_THROW(WindowPlanner(none, 0, 1), std::invalid_argument);
}

// The claim of (T1): planner and arm together, on simulated time, keep ahead of a finger that sweeps to and
// fro at 120 mm/s, with a service that publishes `compute_s` after the post frame.
struct Sweep {
  std::size_t acquired = 0;
  double min_slack_s =
      std::numeric_limits<double>::infinity();  // finger's arrival minus publication, first visits
  bool arrived_at_unknown = false;
};

// What the planner knows of the finger, and the finger of windows, is half of `round_trip_s` late.
Sweep sweep(double compute_s, std::size_t lookahead, double round_trip_s = 0) {
  PlannerOptions options = five_windows();
  options.lookahead = lookahead;
  const double speed = 0.12, left = 0.03, right = 0.27;
  WindowPlanner planner(options, left, +1);
  RobotArm arm({}, 0.0, 0.0);
  auto windows = unknown(5);
  std::vector<double> first_published(5, std::numeric_limits<double>::infinity());
  std::vector<char> visited(5, 0);
  Sweep result;
  double start = -1;
  for (double t = 0; start < 0 || t < start + 10; t += 0.005) {
    const auto finger_at = [&](double time) -> FingerMotion {
      if (start < 0 || time < start) return {false, left, 0};
      const double way = std::fmod((time - start) * speed, 2 * (right - left));
      const bool out = way < right - left;
      return {true, out ? left + way : right - (way - (right - left)), out ? speed : -speed};
    };
    if (t >= arm.free_s()) {
      if (const auto next = planner.next(finger_at(t - round_trip_s / 2), windows, t)) {
        const ArmSchedule schedule = arm.acquire(planner.window_x_m(*next), 0.00045, t);
        windows[*next].acquired_s = schedule.post_frame_s;
        const double told_s = schedule.post_frame_s + compute_s + round_trip_s / 2;
        first_published[*next] = std::min(first_published[*next], told_s);
        ++result.acquired;
      } else if (start < 0) {
        start = t + compute_s;  // all that the start needs is known: the operator may begin
      }
    }
    if (!finger_at(t).present) continue;
    const std::size_t here = planner.window_at(finger_at(t).x_m);
    if (!std::exchange(visited[here], char{1}))
      result.min_slack_s = std::min(result.min_slack_s, t - first_published[here]);
    if (t < first_published[here]) result.arrived_at_unknown = true;
  }
  return result;
}

TEST(WindowPlanner, StaysAheadOfAFingerAt120MillimetresPerSecond) {
  const Sweep run = sweep(0.45, 2);
  EXPECT_FALSE(run.arrived_at_unknown);
  EXPECT_GE(run.min_slack_s, 0.0);
  EXPECT_GE(run.acquired, 14u);  // windows are renewed on every pass
}

// A link of 0.1 s takes as much of the slack: windows are asked for so much earlier.
TEST(WindowPlanner, AFarOperatorWaitsForNoWindow) {
  EXPECT_GE(sweep(0.45, 2, 0.1).min_slack_s, 0.1);
}

TEST(WindowPlanner, OneWindowOfLookaheadWouldStall) {
  EXPECT_TRUE(sweep(0.45, 1).arrived_at_unknown);
}

}  // namespace
}  // namespace teletact::client
