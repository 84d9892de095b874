// What a link lets one expect of the next answer.
#include "client/link/arrival_intervals.h"

#include <gtest/gtest.h>

#include "client/render/force_limits.h"

namespace teletact::client {
namespace {

// `seconds` of answers every `interval_s`, from `*now_s` on.
void come(ArrivalIntervals& arrivals, double* now_s, double seconds, double interval_s) {
  for (const double end_s = *now_s + seconds; *now_s < end_s; *now_s += interval_s)
    arrivals.add(static_cast<std::int64_t>(*now_s * 1e9));
}

TEST(ArrivalIntervals, ExpectTheSteadyRateHoweverLate) {
  EXPECT_EQ(ArrivalIntervals().expected_s(), 0);
  for (const double interval_s : {0.002, 0.03, 0.11, 0.3}) {
    ArrivalIntervals arrivals;
    double now_s = 1000;
    come(arrivals, &now_s, 3, interval_s);
    EXPECT_NEAR(arrivals.expected_s(), interval_s, 1e-6);
  }
}

TEST(ArrivalIntervals, BurstsAreExpectedAStallIsNot) {
  ArrivalIntervals arrivals;
  double now_s = 1000;
  for (int n = 0; n < 40; ++n) {
    come(arrivals, &now_s, 0.01, 0.002);
    now_s += 0.05;
  }
  EXPECT_NEAR(arrivals.expected_s(), 0.05, 0.003);
  come(arrivals, &now_s, 2.5, 0.002);
  EXPECT_NEAR(arrivals.expected_s(), 0.002, 1e-6) << "of the last seconds";
  for (const double stall_s : {0.09, 0.4}) {
    now_s += stall_s;
    come(arrivals, &now_s, 0.5, 0.002);
  }
  EXPECT_NEAR(arrivals.expected_s(), 0.002, 1e-6);
}

TEST(ArrivalIntervals, AStallInThreeOfTenIsWhatTheLinkDoes) {
  ArrivalIntervals arrivals;
  double now_s = 1000;
  for (int tenth = 0; tenth < 40; ++tenth) {
    const double stall_s = tenth % 10 < 3 ? 0.08 : 0;
    now_s += stall_s;
    come(arrivals, &now_s, 0.1 - stall_s, 0.002);
  }
  EXPECT_NEAR(arrivals.expected_s(), 0.08, 0.004);
}

TEST(ArrivalIntervals, WhateverWasShownTheForceIsZeroByHalfASecond) {
  ArrivalIntervals arrivals;
  double now_s = 0;
  come(arrivals, &now_s, 60, 1.7);
  const SilenceLimits limits = silence_limits(arrivals.expected_s());
  EXPECT_LE(limits.fade_s, 0.25);
  EXPECT_LT(limits.zero_s, 0.5);
}

}  // namespace
}  // namespace teletact::client
