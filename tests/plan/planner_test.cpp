#include "service/plan/planner.h"

#include <gtest/gtest.h>

#include <array>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <random>

namespace teletact::service {
namespace {

using std::chrono::milliseconds;
constexpr Planner::Clock::time_point kBegin{};
using Three = std::array<double, 3>;

TEST(Planner, TakesTheCheapestThatIsGoodEnoughElseTheFinest) {
  EXPECT_EQ(Planner().choose(Three{0.9, 0.1, 0}, kBegin), 0u);
  EXPECT_EQ(Planner().choose(Three{1.1, 0.9, 0}, kBegin), 1u);
  EXPECT_EQ(Planner().choose(Three{1.1, 1.1, 1.0}, kBegin), 2u);
  EXPECT_EQ(Planner().choose(Three{5, 4, 3}, kBegin), 2u);
  EXPECT_EQ(Planner().choose(Three{NAN, NAN, NAN}, kBegin), 2u);
}

TEST(Planner, ClimbsAtOnceAndDescendsAfterASecondOfHalfTheTolerance) {
  Planner planner;
  EXPECT_EQ(planner.choose(Three{0.4, 0.2, 0}, kBegin), 0u);
  EXPECT_EQ(planner.choose(Three{1.2, 0.2, 0}, kBegin + milliseconds(1)), 1u);
  EXPECT_EQ(planner.choose(Three{0.9, 0.2, 0}, kBegin + milliseconds(3000)), 1u) << "not half";
  EXPECT_EQ(planner.choose(Three{0.4, 0.2, 0}, kBegin + milliseconds(4000)), 1u);
  EXPECT_EQ(planner.choose(Three{0.4, 0.2, 0}, kBegin + milliseconds(4900)), 1u);
  EXPECT_EQ(planner.choose(Three{0.6, 0.2, 0}, kBegin + milliseconds(4950)), 1u) << "begins anew";
  EXPECT_EQ(planner.choose(Three{0.4, 0.2, 0}, kBegin + milliseconds(5000)), 1u);
  EXPECT_EQ(planner.choose(Three{0.4, 0.2, 0}, kBegin + milliseconds(6000)), 0u);
  EXPECT_EQ(planner.choose(Three{7, 5, 0}, kBegin + milliseconds(6001)), 2u) << "over what is not enough";
}

TEST(Planner, OnABorderItDoesNotGoToAndFro) {
  Planner planner;
  std::mt19937 random(2);
  std::normal_distribution<double> about(1, 0.15);
  std::size_t before = planner.choose(Three{1, 0.5, 0}, kBegin), changes = 0;
  constexpr milliseconds kTenMinutes{600000};
  for (milliseconds t{0}; t < kTenMinutes; t += milliseconds(20)) {
    const std::size_t now = planner.choose(Three{about(random), 0.5, 0}, kBegin + t);
    changes += now != before;
    before = now;
  }
  EXPECT_LE(changes, 1u);  // up, once
  EXPECT_EQ(before, 1u);
}

TEST(Planner, WithNoPatienceItRemembersNothing) {
  Planner planner(Planner::Clock::duration::zero());
  EXPECT_EQ(planner.choose(Three{2, 0.9, 0}, kBegin), 1u);
  EXPECT_EQ(planner.choose(Three{0.9, 0.9, 0}, kBegin), 0u);
}

}  // namespace
}  // namespace teletact::service
