#include "bench/load/trend.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace teletact::bench {
namespace {

using Samples = std::vector<std::array<double, 2>>;

// `count` samples 10 s apart: a line, and noise of which each value keeps `kept` of the one before.
Samples noisy(double per_hour, double kept, unsigned seed, int count = 500) {
  std::mt19937 random(seed);
  std::normal_distribution<double> noise;
  Samples out;
  double off = noise(random) / std::sqrt(1 - kept * kept);
  for (int k = 0; k < count; ++k) {
    const double t = 10. * k;
    out.push_back({t, 100 + per_hour * t / 3600 + off});
    off = kept * off + noise(random);
  }
  return out;
}

double share_below_the_bound(double per_hour, double kept) {
  constexpr unsigned kSeeds = 400;
  unsigned below = 0;
  for (unsigned seed = 0; seed < kSeeds; ++seed)
    below += trend_of(noisy(per_hour, kept, seed)).upper_95 > per_hour;
  return below / double{kSeeds};
}

TEST(Trend, IsThatOfAStraightLineAndOfWhatNeverMoves) {
  Samples line;
  for (int k = 0; k < 10; ++k) line.push_back({60. * k, 5 + 3. * k / 60});
  EXPECT_NEAR(trend_of(line).per_hour, 3, 1e-12);
  Samples constant;
  for (int k = 0; k < 100; ++k) constant.push_back({10. * k, 0.1});
  EXPECT_EQ(trend_of(constant).per_hour, 0);
  EXPECT_EQ(trend_of(constant).upper_95, 0);
}

TEST(Trend, TheBoundHoldsForNoiseAlsoWhenItStaysForAMinute) {
  EXPECT_NEAR(share_below_the_bound(2, 0), 0.95, 0.03);
  EXPECT_NEAR(share_below_the_bound(2, 0.85), 0.95, 0.05) << "six samples stay much the same";
}

TEST(Trend, WhatHardlyMovesIsNotKnownTooWell) {
  // One step: five hundred samples, two values.
  Samples step;
  for (int k = 0; k < 500; ++k) step.push_back({10. * k, k < 250 ? 0. : 1.});
  const Trend trend = trend_of(step);
  EXPECT_GT(trend.upper_95, 1.5 * trend.per_hour);
  EXPECT_TRUE(std::isnan(trend_of({{0, 1}, {1, 1}}).upper_95));
}

}  // namespace
}  // namespace teletact::bench
