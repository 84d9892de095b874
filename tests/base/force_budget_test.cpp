#include "service/base/force_budget.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace teletact::service {
namespace {

TEST(ForceBudget, OfNothingIsNothing) {
  EXPECT_EQ(ForceBudget{}.half_width(), 0);
  EXPECT_EQ(ForceBudget{}.relative(ErrorTerm::kMesh), 0);
}

TEST(ForceBudget, BoundsAddUpAndTheRestAsSquares) {
  ForceBudget budget;
  budget.add({ErrorTerm::kSolver, TermKind::kBound, 0.01});
  budget.add({ErrorTerm::kMesh, TermKind::kEstimate, 0.03});
  budget.add({ErrorTerm::kModulus, TermKind::kDeviation, 0.04});
  EXPECT_NEAR(budget.half_width(), 0.01 + 1.96 * 0.05, 1e-12);
  EXPECT_NEAR(budget.of_model(), 0.01 + 1.96 * 0.03, 1e-12);
  EXPECT_EQ(budget.relative(ErrorTerm::kModulus), 0.04);
  budget.add({ErrorTerm::kSlices, TermKind::kDeviation, 0.12});
  EXPECT_NEAR(budget.half_width(), 0.01 + 1.96 * 0.13, 1e-12);
  EXPECT_NEAR(budget.of_model(), 0.01 + 1.96 * 0.03, 1e-12) << "no model makes that less";
}

// Draws of what the terms say they are: the interval holds what it says.
TEST(ForceBudget, TheIntervalHoldsTheTruthInNinetyFiveOfAHundred) {
  ForceBudget budget;
  budget.add({ErrorTerm::kMesh, TermKind::kEstimate, 0.02});
  budget.add({ErrorTerm::kModulus, TermKind::kDeviation, 0.05});
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  int held = 0;
  constexpr int kDraws = 20000;
  for (int n = 0; n < kDraws; ++n)
    held += std::abs(0.02 * normal(random) + 0.05 * normal(random)) <= budget.half_width();
  EXPECT_NEAR(double(held) / kDraws, 0.95, 0.01);
}

// A modulus that is badly known excuses no model.
TEST(Tolerance, IsAShareOrNewtonsOfWhatAModelMayBeOffBy) {
  ForceBudget budget;
  budget.add({ErrorTerm::kMesh, TermKind::kEstimate, 0.05 / 1.96});
  EXPECT_FALSE((Tolerance{0.03, 0}.allows(budget, 1)));
  EXPECT_TRUE((Tolerance{0.06, 0}.allows(budget, 1)));
  EXPECT_TRUE((Tolerance{0.03, 0.005}.allows(budget, 0.09)));
  EXPECT_FALSE((Tolerance{0.03, 0.005}.allows(budget, 0.11)));
  budget.add({ErrorTerm::kModulus, TermKind::kDeviation, 0.12});
  EXPECT_FALSE((Tolerance{0.03, 0}.allows(budget, 1)));
  EXPECT_TRUE((Tolerance{0.06, 0}.allows(budget, 1)));
}

}  // namespace
}  // namespace teletact::service
