// What a session's ticks add up to: right to a percent, of a size that does not grow.
#include "client/servo/histogram.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <random>
#include <vector>

#include "client/servo/tick_statistics.h"
#include "tests/support/allocation/allocation_count.h"

namespace teletact::client {
namespace {

// GIVEN values over many decades, of both signs and zero, WHEN a share of them is asked for, THEN it is that
// of the values themselves to a percent.
TEST(Histogram, IsRightToAPercentOverAllOfItsRange) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(0, 1);
  for (const auto& [low, high, negative, zero] :
       {std::tuple{1e-8, 1e5, 0.0, 0.0}, {1e-6, 1e-2, 0.0, 0.1}, {1e-4, 1e-3, 0.3, 0.01}}) {
    Histogram histogram;
    std::vector<double> values;
    for (int n = 0; n < 20000; ++n) {
      double value = low * std::pow(high / low, uniform(random));
      if (uniform(random) < negative) value = -value;
      if (uniform(random) < zero) value = 0;
      values.push_back(value);
      histogram.add(value);
    }
    EXPECT_EQ(histogram.count(), values.size());
    for (const double share : {0.0, 0.001, 0.01, 0.1, 0.25, 0.5, 0.75, 0.9, 0.99, 0.999, 1.0}) {
      const double exact = percentile(values, share);
      EXPECT_LE(std::abs(histogram.percentile(share) - exact), Histogram::kRelativeError * std::abs(exact))
          << share << ' ' << exact;
    }
    EXPECT_EQ(histogram.percentile(0), percentile(values, 0));
    EXPECT_EQ(histogram.percentile(1), percentile(values, 1));
  }
}

TEST(Histogram, OfNoneOfOneAndOfWhatIsBeyondItsRange) {
  Histogram histogram;
  EXPECT_EQ(histogram.percentile(0.5), 0);
  histogram.add(std::nan(""));
  EXPECT_EQ(histogram.count(), 0u);
  histogram.add(0.0123);
  for (const double share : {0.0, 0.5, 1.0}) EXPECT_EQ(histogram.percentile(share), 0.0123);
  for (const double value : {1e30, -1e30, 1e-30, double{INFINITY}}) histogram.add(value);
  EXPECT_EQ(histogram.count(), 5u);
  EXPECT_EQ(histogram.percentile(0), -1e30);
  EXPECT_EQ(histogram.percentile(0.4), 0);
  EXPECT_NEAR(histogram.percentile(0.6), 0.0123, 1e-2 * 0.0123);
  EXPECT_EQ(histogram.percentile(1), INFINITY);
}

// An hour beside the service: 3.6 million ticks, and states that flicker.
TEST(TickStatistics, TakeNoMemoryHoweverLongTheSession) {
  const auto statistics = std::make_unique<TickStatistics>();
  ServoTick tick;
  teletact::test::count_allocations(true);
  for (int n = 0; n < 100'000; ++n) {
    tick.time_ns += 1'000'000;
    tick.lateness_s = 1e-6 * (n % 500);
    tick.slack_s = 1e-3 - tick.lateness_s;
    tick.model_age_s = 0.01;
    tick.state = n % 7 == 0 ? ServoState::kPaused : ServoState::kEnabled;
    statistics->add(tick);
  }
  teletact::test::count_allocations(false);
  EXPECT_EQ(teletact::test::counted_allocations(), 0u);
  EXPECT_EQ(statistics->lateness_s().count(), 100'000u);
  EXPECT_EQ(statistics->period_s().count(), 99'999u);
  EXPECT_NEAR(statistics->lateness_s().percentile(0.5), 2.5e-4, 3e-6);
  EXPECT_NEAR(statistics->slack_s().percentile(0), 1e-3 - 499e-6, 1e-9);
  EXPECT_EQ(statistics->changes().size(), TickStatistics::kMaxChanges);
  EXPECT_NEAR(static_cast<double>(statistics->changes_left_out()), 2 * 100'000 / 7.0, 1010);
}

}  // namespace
}  // namespace teletact::client
