// What the load generator says of latencies: within 1 %, of one process as of several, and nothing where too
// few were seen.
#include "bench/load/latency_histogram.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <random>
#include <vector>

namespace teletact::bench {
namespace {

TEST(LatencyHistogram, QuantilesAreWithinOnePercent) {
  std::mt19937_64 random(1);
  std::lognormal_distribution<double> draw(std::log(2e-3), 1.5);
  std::vector<double> all;
  LatencyHistogram one, half, other;
  for (int k = 0; k < 20001; ++k) {
    all.push_back(draw(random));
    one.add(all.back());
    (k % 2 == 0 ? half : other).add(all.back());
  }
  half.add(other);
  std::sort(all.begin(), all.end());
  for (const double q : {0.01, 0.5, 0.95, 0.99, 0.999, 1.0}) {
    const double exact = all[static_cast<std::size_t>(std::ceil(q * 20001)) - 1];
    EXPECT_NEAR(one.quantile(q) / exact, 1, 0.01) << q;
    EXPECT_EQ(half.quantile(q), one.quantile(q)) << q << ": of two processes";
  }
  EXPECT_EQ(one.max_s(), all.back());
  const auto shares = one.shares();
  EXPECT_EQ(shares.back().at_most, 1);
  const auto half_of_all =
      std::find_if(shares.begin(), shares.end(), [](auto& s) { return s.at_most >= 0.5; });
  EXPECT_EQ(half_of_all->seconds, one.quantile(0.5));
  EXPECT_NEAR(half_of_all->at_most, 0.5, 0.02);
  EXPECT_EQ(nlohmann::json(one).get<LatencyHistogram>().quantile(0.99), one.quantile(0.99));
  EXPECT_EQ(nlohmann::json(one).get<LatencyHistogram>().count(), one.count());
}

TEST(LatencyHistogram, ATailOfTooFewIsNotShown) {
  LatencyHistogram few;
  for (int k = 0; k < 458; ++k) few.add(1e-3);
  EXPECT_FALSE(few.bound(0.99));
  EXPECT_TRUE(few.bound(0.95));
  few.add(2e-3);
  ASSERT_TRUE(few.bound(0.99)) << "0.99^459 < 0.01";
  EXPECT_EQ(*few.bound(0.99), 2e-3);
  EXPECT_TRUE(std::isnan(LatencyHistogram().quantile(0.5)));
  EXPECT_FALSE(LatencyHistogram().bound(0.5));
}

// The bound is above the population's quantile in 99 of 100 runs.
TEST(LatencyHistogram, TheBoundHoldsAsOftenAsItSays) {
  std::mt19937_64 random(3);
  std::exponential_distribution<double> draw(1e3);
  const double truth_s = -std::log(0.01) * 1e-3;
  int held = 0;
  for (int run = 0; run < 300; ++run) {
    LatencyHistogram h;
    for (int k = 0; k < 2000; ++k) h.add(draw(random));
    held += *h.bound(0.99) >= truth_s;
  }
  EXPECT_GE(held, 290);
  EXPECT_LE(held, 300);
}

}  // namespace
}  // namespace teletact::bench
