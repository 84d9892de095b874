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
  cost.late(now);
  EXPECT_NEAR(cost.expected_s(size, now), kAll, 1e-3 * kAll);
}

TEST_F(Cost, OfPartsThatWereNotDoneStaysAsItWas) {
  take(1);
  cost.took(size, {0, 0, 0}, now);
  EXPECT_NEAR(cost.expected_s(size, now), kAll, 1e-3 * kAll);
}

double of(const std::array<double, 4>& seconds, ModulusKind kind) {
  return seconds[static_cast<std::size_t>(kind)];
}

// GIVEN a machine that is ten times as quick as is first assumed, and shows it by one method, THEN no other
// is expected to be as slow as on that.
TEST_F(Cost, OfAMethodThatWasNeverTriedFollowsTheOthers) {
  const auto before = cost.expected_modulus_s(size, now);
  for (int k = 0; k < 40; ++k) cost.took(size, {0, 0.1 * of(before, ModulusKind::kDirect), 0}, now);
  for (const ModulusKind kind : {ModulusKind::kReferenceStress, ModulusKind::kIterative, ModulusKind::kSolid})
    EXPECT_NEAR(of(cost.expected_modulus_s(size, now), kind), 0.1 * of(before, kind),
                1e-3 * of(before, kind));
}

// GIVEN windows that the iterative method works on for as long as a finger stands, THEN its start is not
// expected to take long, and once the finger moves there is time for it.
TEST_F(Cost, OfAStartIsWhatItTookHoweverLongTheIterationWentOn) {
  size.method = ModulusKind::kIterative;
  for (int k = 0; k < 40; ++k) cost.took(size, {kTracking, 2, kPublishing, 0.1}, now);
  EXPECT_NEAR(of(cost.expected_modulus_s(size, now), ModulusKind::kDirect), 0.1, 1e-3);
  EXPECT_NEAR(of(cost.expected_modulus_s(size, now), ModulusKind::kIterative), 2, 1e-2);
  EXPECT_NEAR(cost.expected_publishing_s(size, now), kPublishing, 1e-4);
}

}  // namespace
}  // namespace teletact::service
