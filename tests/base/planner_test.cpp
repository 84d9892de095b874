#include "service/base/planner.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <random>

namespace teletact::service {
namespace {

using std::chrono::milliseconds;
constexpr Planner::Clock::time_point kBegin{};

TEST(Planner, TakesSharesWhereTheyAreGoodEnough) {
  EXPECT_TRUE(Planner().takes_shares(0.9, kBegin));
  EXPECT_TRUE(Planner().takes_shares(1.0, kBegin));
  EXPECT_FALSE(Planner().takes_shares(1.1, kBegin));
  EXPECT_FALSE(Planner().takes_shares(NAN, kBegin));
}

TEST(Planner, ReturnsToSharesAfterASecondOfHalfTheTolerance) {
  Planner planner;
  EXPECT_TRUE(planner.takes_shares(0.4, kBegin));
  EXPECT_FALSE(planner.takes_shares(1.2, kBegin + milliseconds(1)));
  EXPECT_FALSE(planner.takes_shares(0.9, kBegin + milliseconds(3000))) << "not half";
  EXPECT_FALSE(planner.takes_shares(0.4, kBegin + milliseconds(4000)));
  EXPECT_FALSE(planner.takes_shares(0.4, kBegin + milliseconds(4900)));
  EXPECT_FALSE(planner.takes_shares(0.6, kBegin + milliseconds(4950))) << "begins anew";
  EXPECT_FALSE(planner.takes_shares(0.4, kBegin + milliseconds(5000)));
  EXPECT_TRUE(planner.takes_shares(0.4, kBegin + milliseconds(6000)));
  EXPECT_FALSE(planner.takes_shares(5, kBegin + milliseconds(6001)));
  EXPECT_FALSE(planner.takes_shares(0.4, kBegin + milliseconds(6500)));
  EXPECT_FALSE(planner.takes_shares(0.4, kBegin + milliseconds(7400))) << "since it left";
}

TEST(Planner, OnABorderItDoesNotGoToAndFro) {
  Planner planner;
  std::mt19937 random(2);
  std::normal_distribution<double> about(1, 0.15);
  bool before = planner.takes_shares(1, kBegin);
  int changes = 0;
  constexpr milliseconds kTenMinutes{600000};
  for (milliseconds t{0}; t < kTenMinutes; t += milliseconds(20)) {
    const bool now = planner.takes_shares(about(random), kBegin + t);
    changes += now != before;
    before = now;
  }
  EXPECT_LE(changes, 1);  // to the nodes, once
  EXPECT_FALSE(before);
}

TEST(Planner, WithNoPatienceItRemembersNothing) {
  Planner planner(Planner::Clock::duration::zero());
  EXPECT_FALSE(planner.takes_shares(2, kBegin));
  EXPECT_TRUE(planner.takes_shares(0.9, kBegin));
}

}  // namespace
}  // namespace teletact::service
