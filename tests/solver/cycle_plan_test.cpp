#include "service/solver/level_layout.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace teletact::service {
namespace {

TEST(CyclePlan, IsThePalindromeThatSymmetryNeeds) {
  for (const std::size_t levels : {1u, 2u, 3u, 5u}) {
    const std::vector<PlannedStep> plan = plan_cycle(levels, 2);
    // Smoothings and transfers in their order, (level, what).
    std::vector<std::pair<int, char>> there;
    std::size_t solves = 0;
    for (const PlannedStep& s : plan) {
      solves += s.step == CycleStep::kSolve;
      if (s.step == CycleStep::kSmooth && s.k == 1) there.emplace_back(s.level, 's');
      if (s.step == CycleStep::kRestrict) there.emplace_back(s.level, 'r');
      if (s.step == CycleStep::kProlong) there.emplace_back(s.level, 'p');
    }
    auto back = there;
    std::reverse(back.begin(), back.end());
    for (auto& [level, what] : back) what = what == 's' ? 's' : what == 'r' ? 'p' : 'r';
    EXPECT_EQ(back, there) << levels;
    EXPECT_EQ(solves, levels < 4 ? 1u : std::size_t{1} << (levels - 3)) << levels;
  }
}

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
