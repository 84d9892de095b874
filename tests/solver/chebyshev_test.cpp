#include "service/solver/chebyshev.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace teletact::service {
namespace {

TEST(Chebyshev, PolynomialIsSmallOnItsInterval) {
  // Error polynomial of z -> z + ... for the scalar problem a z = 1, at many a.
  const double highest = 4;
  for (const unsigned steps : {1u, 2u, 3u, 4u}) {
    const auto coefficients = chebyshev_steps(highest / 10, highest, steps);
    ASSERT_EQ(coefficients.size(), steps);
    double worst = 0;
    for (double a = highest / 10; a <= highest; a += 0.01) {
      double z = 0, d = 0;
      for (const auto& c : coefficients) z += d = c.old_direction * d + c.new_residual * (1 - a * z);
      worst = std::max(worst, std::abs(1 - a * z));
    }
    // 1 / T_k((b + a) / (b - a))
    const double bound = 1 / std::cosh(steps * std::acosh((1 + 0.1) / (1 - 0.1)));
    EXPECT_LE(worst, bound * (1 + 1e-9)) << steps;
  }
}

}  // namespace
}  // namespace teletact::service
