#include "service/solver/cycle_plan.h"

#include <gtest/gtest.h>

#include <algorithm>
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

}  // namespace
}  // namespace teletact::service
