#include "bench/load/arrivals.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>
#include <vector>

namespace teletact::bench {
namespace {

std::vector<double> all_of(Arrivals arrivals) {
  std::vector<double> out;
  for (double t = arrivals.next(); std::isfinite(t); t = arrivals.next()) out.push_back(t);
  return out;
}

TEST(Arrivals, OfAnEvenRateAreEvenlySpacedAndClientsAreNotInStep) {
  const std::vector<double> one = all_of({{100, 100, 2, false}, 0, 1}),
                            two = all_of({{100, 100, 2, false}, 1, 1});
  EXPECT_NEAR(one.size(), 200, 1);
  EXPECT_GE(one.front(), 0);
  for (std::size_t k = 1; k < one.size(); ++k) EXPECT_NEAR(one[k] - one[k - 1], 0.01, 1e-9);
  EXPECT_GT(std::abs(one.front() - two.front()), 1e-3);
}

TEST(Arrivals, OfARisingRateCountWhatItsMeanSays) {
  const std::vector<double> times = all_of({{10, 90, 10, false}, 0, 1});
  EXPECT_NEAR(times.size(), 500, 1);
  EXPECT_NEAR(times[1] - times[0], 0.1, 0.02);
  EXPECT_NEAR(times.back() - times[times.size() - 2], 1. / 90, 1e-3);
  EXPECT_NEAR(all_of({{90, 10, 10, false}, 0, 1}).size(), 500, 1) << "and of a falling one";
}

TEST(Arrivals, OfAPoissonProcessAreAsIrregularAsItSays) {
  const std::vector<double> times = all_of({{1000, 1000, 20, true}, 3, 7});
  EXPECT_NEAR(times.size(), 20000, 500);
  double sum = 0, squares = 0;
  for (std::size_t k = 1; k < times.size(); ++k)
    sum += times[k] - times[k - 1], squares += std::pow(times[k] - times[k - 1], 2);
  const double n = static_cast<double>(times.size() - 1), mean = sum / n;
  EXPECT_NEAR(std::sqrt(squares / n - mean * mean) / mean, 1, 0.05);
  EXPECT_NE(all_of({{1000, 1000, 20, true}, 4, 7}).front(), times.front());
  EXPECT_EQ(all_of({{1000, 1000, 20, true}, 3, 7}), times) << "the seed says it all";
}

TEST(Arrivals, RatesMustBeAboveZero) {
  EXPECT_THROW(Arrivals({0, 1, 1, false}, 0, 1), std::invalid_argument);
  EXPECT_THROW(Arrivals({1, 1, 0, false}, 0, 1), std::invalid_argument);
}

}  // namespace
}  // namespace teletact::bench
