// What is expected of an estimate, by what the ones before took; time is told.
#include "service/imaging_plane/estimate_cost.h"

#include <gtest/gtest.h>

namespace teletact::service {
namespace {

using std::chrono::minutes;

class Cost : public testing::Test {
 protected:
  Cost() {
    size.samples = 2000, size.lines = 128, size.window_width_m = 0.04, size.depth_m = 0.04;
    size.method = ModulusKind::kDirect, size.published = true;
  }
  void take(double share) {
    for (int k = 0; k < 40; ++k)
      cost.took(size, {share * kTracking, share * kModulus, share * kPublishing}, now);
  }
  void refuse() { cost.refused(size, 2 * kAll, now); }
  static constexpr double kTracking = 0.05, kModulus = 0.02, kPublishing = 0.01, kAll = 0.08;
  EstimateSize size;
  EstimateCost cost;
  EstimateCost::Time now = std::chrono::steady_clock::now();
};

TEST_F(Cost, IsLearntFromWhatItTook) {
  take(1);
  EXPECT_NEAR(cost.expected_s(size, now), kAll, 1e-3 * kAll);
  EstimateSize twice = size;
  twice.lines *= 2;
  EXPECT_NEAR(cost.expected_s(twice, now), kAll + kTracking, 1e-3 * kAll);
  twice.published = false;
  EXPECT_NEAR(cost.expected_s(twice, now), kAll + kTracking - kPublishing, 1e-3 * kAll);
}

// GIVEN a minute in which everything took ten times as long, and windows that are refused for it ever since,
// THEN they are tried again, and one that is done in its time puts it right.
TEST_F(Cost, OfABusyMinuteIsNotBelievedForEver) {
  take(10);
  EXPECT_NEAR(cost.expected_s(size, now), 10 * kAll, 1e-2 * kAll);
  for (int k = 0; k <= 5; ++k, now += minutes(1)) refuse();
  EXPECT_NEAR(cost.expected_s(size, now), 5 * kAll, 1e-2 * kAll);
  for (int k = 0; k < 20; ++k, now += minutes(1)) refuse();
  EXPECT_NEAR(cost.expected_s(size, now), kAll, 1e-2 * kAll);
  take(1);
  EXPECT_NEAR(cost.expected_s(size, now), kAll, 1e-2 * kAll);
}

// GIVEN a night in which nobody asked for anything, THEN a window that could not be done in its time is
// refused in the morning, and not late.
TEST_F(Cost, IsNotForgottenWhileNobodyAsks) {
  take(1);
  now += minutes(5);
  EXPECT_NEAR(cost.expected_s(size, now), 0.5 * kAll, 1e-3 * kAll);
  now += minutes(1000);
  EXPECT_NEAR(cost.expected_s(size, now), 0.5 * kAll, 1e-3 * kAll);
  refuse();
  EXPECT_NEAR(cost.expected_s(size, now), 0.5 * kAll, 1e-3 * kAll);
  take(1);
  now += minutes(10);
  EXPECT_NEAR(cost.expected_s(size, now), 0.5 * kAll, 1e-3 * kAll) << "the refusal was of before";
}

// GIVEN one that was refused, THEN what is expected of the next falls while more are refused, and not by
// itself.
TEST_F(Cost, FallsBetweenRefusalsAlone) {
  take(1);
  refuse();
  now += minutes(30);
  EXPECT_NEAR(cost.expected_s(size, now), 0.5 * kAll, 1e-3 * kAll);
  refuse();  // the second, after a pause that counts as one of 5 minutes
  EXPECT_NEAR(cost.expected_s(size, now), 0.5 * kAll, 1e-3 * kAll);
  now += minutes(30);
  refuse();
  EXPECT_NEAR(cost.expected_s(size, now), 0.25 * kAll, 1e-3 * kAll);
}

// GIVEN wishes that could not be met at any time, THEN to refuse them says nothing of those that could.
TEST_F(Cost, DoesNotFallForWhatIsHopelessAnyway) {
  take(1);
  for (int k = 0; k < 30; ++k, now += minutes(1)) cost.refused(size, 0.09 * kAll, now);
  EXPECT_NEAR(cost.expected_s(size, now), 0.5 * kAll, 1e-3 * kAll);
  for (int k = 0; k < 30; ++k, now += minutes(1)) cost.refused(size, 0.11 * kAll, now);
  EXPECT_NEAR(cost.expected_s(size, now), 0.1 * kAll, 1e-3 * kAll);
}

TEST_F(Cost, IsBelievedAgainWhenWhatWasTriedIsLate) {
  take(1);
  for (int k = 0; k < 30; ++k, now += minutes(1)) refuse();
  EXPECT_NEAR(cost.expected_s(size, now), 0.1 * kAll, 1e-3 * kAll);
  cost.late(size, kAll, now);
  EXPECT_NEAR(cost.expected_s(size, now), kAll, 1e-3 * kAll);
  cost.late(size, 2 * kAll, now);
  EXPECT_GT(cost.expected_s(size, now), 1.2 * kAll) << "it takes that long at least";
}

TEST_F(Cost, OfPartsThatWereNotDoneStaysAsItWas) {
  take(1);
  cost.took(size, {0, 0, 0}, now);
  EXPECT_NEAR(cost.expected_s(size, now), kAll, 1e-3 * kAll);
}

// GIVEN a machine that is ten times as quick as is first assumed, and shows it by methods that begin with
// another, THEN no other is expected to be as slow as on that, nor quicker.
TEST_F(Cost, OfAMethodThatWasNeverTriedFollowsTheOthers) {
  const auto expected_s = [&](ModulusKind kind) {
    EstimateSize other = size;
    other.method = kind;
    return cost.expected_s(other, now);
  };
  cost.took(size, {1e-9, 0, 1e-9}, now);
  for (int k = 0; k < 60; ++k) cost.took(size, {1e-9, 0, 1e-9}, now);  // the modulus is all that counts
  const double solid_s = expected_s(ModulusKind::kSolid),
               reference_s = expected_s(ModulusKind::kReferenceStress);
  const ModulusCost usual = usual_modulus(size);
  size.method = ModulusKind::kIterative;
  for (int k = 0; k < 60; ++k)  // 0.3 of a usual core, a tenth of the slow one
    cost.took(size, {1e-9, 0.3 * (usual.direct_s + 6 * usual.step_s), 1e-9, 0.3 * usual.direct_s, 5}, now);
  EXPECT_NEAR(expected_s(ModulusKind::kSolid), 0.1 * solid_s, 1e-2 * solid_s);
  EXPECT_NEAR(expected_s(ModulusKind::kReferenceStress), 0.1 * reference_s, 1e-2 * reference_s);
}

// GIVEN windows of many steps, and solids of many solves, THEN what one takes is known.
TEST_F(Cost, OfAStepIsItsShare) {
  size.method = ModulusKind::kIterative;
  for (int k = 0; k < 40; ++k) cost.took(size, {kTracking, 2.1, kPublishing, 0.1, 9}, now);
  EXPECT_NEAR(cost.expected_publishing_s(size, now), kPublishing, 1e-4);
  EXPECT_NEAR(cost.expected_s(size, now), kTracking + 2.1 + kPublishing, 1e-2);
  EXPECT_NEAR(cost.min_s(size, false, now), kTracking + 0.1 + kPublishing, 1e-2) << "its start alone";
  EXPECT_EQ(cost.budget(size, 0.1 + 1.25 * 0.2 * 4.5, "", now).steps, 3);
  EXPECT_FALSE(cost.budget(size, 0.09, "", now).start);
  now += minutes(10);
  EXPECT_TRUE(cost.budget(size, 0.09, "", now).start) << "it is tried again";
  EXPECT_EQ(cost.budget(size, 0.1 + 1.25 * 0.2 * 4.5, "", now).steps, 3)
      << "and planned by what was measured";
  size.method = ModulusKind::kSolid;
  for (int k = 0; k < 40; ++k) cost.took(size, {kTracking, 3, kPublishing, 0, 30}, now);
  EXPECT_NEAR(cost.expected_s(size, now), kTracking + 3 + kPublishing, 1e-2);
  EXPECT_LT(cost.min_s(size, false, now), cost.expected_s(size, now) / 2);
  EXPECT_EQ(cost.budget(size, 1.25 * 0.1 * 12.5, "", now).solves, 12);
}

// GIVEN iterations that had time for no step, THEN their rest says nothing of the direct method, nor of a
// step.
TEST_F(Cost, OfAStartAloneIsThatOfTheStart) {
  const double step_s = usual_modulus(size).step_s;
  size.method = ModulusKind::kIterative;
  for (int k = 0; k < 40; ++k) cost.took(size, {kTracking, 0.11, kPublishing, 0.1, 0}, now);
  EXPECT_FALSE(cost.budget(size, 0.099, "", now).start);
  EXPECT_TRUE(cost.budget(size, 0.101, "", now).start);
  EXPECT_LT(cost.budget(size, 0.1 + 100 * step_s, "", now).steps, 200);
}

// A limit of time is counted: the same on every machine, however long estimates take there.
TEST_F(Cost, OfALimitIsTheUsualCores) {
  const ModulusCost usual = usual_modulus(size);
  const ModulusBudget limit = usual.within(usual.direct_s + 5.5 * 1.25 * usual.step_s, "a limit");
  EXPECT_TRUE(limit.start);
  EXPECT_EQ(limit.steps, 4);
  EXPECT_FALSE(usual.within(usual.direct_s / 2, "a limit").start);
  EXPECT_GT(usual.within(20, "").steps, 16) << "all that there are";
  EXPECT_EQ(usual.within(HUGE_VAL, "").steps, 1000000);
  size.method = ModulusKind::kIterative;
  for (int k = 0; k < 40; ++k)
    cost.took(size,
              {kTracking, 10 * (usual.direct_s + 6 * usual.step_s), kPublishing, 10 * usual.direct_s, 5},
              now);
  EXPECT_LT(cost.budget(size, 10 * usual.direct_s + 5.5 * 1.25 * usual.step_s, "", now).steps, 1);
  EXPECT_EQ(usual_modulus(size).within(usual.direct_s + 5.5 * 1.25 * usual.step_s, "").steps, 4);
}

TEST(ModulusBudget, OfTwoTheLessHoldsAndSaysWhy) {
  ModulusBudget budget{true, 10, 50, "steps by a", "solves by a"};
  budget.restrict_to({true, 5, 80, "steps by b", "solves by b"});
  EXPECT_EQ(budget.steps, 5);
  EXPECT_EQ(budget.solves, 50);
  EXPECT_EQ(budget.why_steps, "steps by b");
  EXPECT_EQ(budget.why_solves, "solves by a");
  budget.restrict_to({false, 0, 9, "no start by c", "solves by c"});
  budget.restrict_to({true, 0, 9, "steps by d", "solves by d"});
  EXPECT_FALSE(budget.start);
  EXPECT_EQ(budget.why_steps, "no start by c");
  EXPECT_EQ(budget.why_solves, "solves by c");
}

}  // namespace
}  // namespace teletact::service
