#include "service/tissue/grid.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "tests/tissue/tissue_cases.h"

namespace teletact {
namespace {

using service::graded_coordinates;
using service::TissueGrid;
using service::uniform_coordinates;

TEST(Grid, UniformCoordinatesEndExactly) {
  const auto x = uniform_coordinates(0.1, 0.4, 7);
  ASSERT_EQ(x.size(), 8u);
  EXPECT_EQ(x.front(), 0.1);
  EXPECT_EQ(x.back(), 0.4);
  for (std::size_t i = 1; i < x.size(); ++i) EXPECT_NEAR(x[i] - x[i - 1], 0.3 / 7, 1e-15);
}

TEST(Grid, GradedCoordinatesAreFineInsideAndGrowOutside) {
  const auto x = graded_coordinates(-0.060, 0.120, 0.0, 0.060, 1e-3, 6e-3, 1.3);
  EXPECT_EQ(x.front(), -0.060);
  EXPECT_EQ(x.back(), 0.120);
  std::size_t inside = 0;
  for (std::size_t i = 1; i < x.size(); ++i) {
    const double step = x[i] - x[i - 1];
    EXPECT_GT(step, 0);
    EXPECT_LE(step, 6e-3 * (1 + 1e-12));
    if (x[i - 1] >= -1e-12 && x[i] <= 0.060 + 1e-12) {
      EXPECT_NEAR(step, 1e-3, 1e-12);
      ++inside;
    }
    if (i > 1) {
      EXPECT_LE(step, 1.3 * 1.0001 * (x[i - 1] - x[i - 2]));
      EXPECT_GE(step, (x[i - 1] - x[i - 2]) / (1.3 * 1.0001));
    }
  }
  EXPECT_EQ(inside, 60u);
  EXPECT_LE(x.size(), 100u);
  service::validate(TissueGrid{x, {0, 1e-3}});
}

TEST(Grid, GradedCoordinatesWithoutContextAreTheFineOnes) {
  const auto x = graded_coordinates(0, 0.010, 0, 0.010, 1e-3, 4e-3, 1.2),
             y = uniform_coordinates(0, 0.010, 10);
  ASSERT_EQ(x.size(), y.size());
  for (std::size_t i = 0; i < x.size(); ++i) EXPECT_NEAR(x[i], y[i], 1e-15);
}

TEST(Grid, UnusableCoordinatesAreRefused) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(uniform_coordinates(0, 0, 3), std::invalid_argument);
  EXPECT_THROW(uniform_coordinates(0, nan, 3), std::invalid_argument);
  EXPECT_THROW(uniform_coordinates(0, 1, 0), std::invalid_argument);
  EXPECT_THROW(graded_coordinates(0, 1, -0.1, 0.5, 0.1, 0.2, 1.2), std::invalid_argument);
  EXPECT_THROW(graded_coordinates(0, 1, 0.2, 0.5, 0, 0.2, 1.2), std::invalid_argument);
  EXPECT_THROW(graded_coordinates(0, 1, 0.2, 0.5, 0.1, 0.05, 1.2), std::invalid_argument);
  EXPECT_THROW(graded_coordinates(0, 1, 0.2, 0.5, 0.1, 0.2, 1.0), std::invalid_argument);
  EXPECT_THROW(graded_coordinates(nan, 1, 0.2, 0.5, 0.1, 0.2, 1.2), std::invalid_argument);
  EXPECT_THROW(service::validate(TissueGrid{{0, nan}, {0, 1}}), std::invalid_argument);
  EXPECT_THROW(service::validate(TissueGrid{{0}, {0, 1}}), std::invalid_argument);
}

}  // namespace
}  // namespace teletact
