// By which method a modulus is found where nobody names one; figures of T3.8.
#include "service/imaging/modulus/modulus_plan.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace teletact::service {
namespace {

const ModulusNeed kUsual{0.03, std::hypot(0.03, 0.05)};
const Unevenness kEven{}, kLump{0.5, 0.05}, kSoft{0.02, 0.2};
constexpr double kQuiet = 0.01;

ModulusTime time_of(std::optional<double> left_s) {
  return {left_s, "the 0.50 s of a window", {0.05, 0.1, 0.3, 1}};
}
bool says(const ModulusPlan& plan, const char* words) {
  return plan.why.find(words) != std::string::npos;
}

TEST(ModulusPlan, IsIterativeWhereThereIsTimeAndLittleNoise) {
  for (const Unevenness& uneven : {kEven, kLump, kSoft})
    for (const std::optional<double> left_s : {std::optional<double>{}, std::optional(0.4)}) {
      const ModulusPlan plan = plan_modulus(kUsual, kQuiet, uneven, time_of(left_s));
      EXPECT_EQ(plan.kind, ModulusKind::kIterative);
      EXPECT_DOUBLE_EQ(plan.tolerance, 0.03);
      EXPECT_TRUE(says(plan, "iterative")) << plan.why;
    }
  EXPECT_TRUE(says(plan_modulus(kUsual, kQuiet, kEven, {}), "3.0 % of the force"))
      << "nothing is known of the time";
}

TEST(ModulusPlan, IsCheaperWhereTheSensorLeavesMoreOpenThanItCures) {
  const ModulusPlan plan = plan_modulus({0.03, 0.15}, kQuiet, kEven, time_of({}));
  EXPECT_EQ(plan.kind, ModulusKind::kReferenceStress);
  EXPECT_DOUBLE_EQ(plan.tolerance, 0.075);
  EXPECT_TRUE(says(plan, "leave 15.0 % open")) << plan.why;
  EXPECT_EQ(plan_modulus({0.03, 0.15}, kQuiet, kLump, time_of({})).kind, ModulusKind::kIterative)
      << "what reference stress loses of a lump is more";
  EXPECT_DOUBLE_EQ(plan_modulus({0.03, 1}, kQuiet, kEven, time_of({})).tolerance, 0.1) << "and no more";
}

// Total variation takes out what reference stress leaves (decision 0032).
TEST(ModulusPlan, IsNotCheaperWhereThereIsNoise) {
  EXPECT_EQ(plan_modulus({0.1, 0}, 0.15, kEven, time_of({})).kind, ModulusKind::kReferenceStress);
  const ModulusPlan noisy = plan_modulus({0.1, 0}, 0.5, {0.15, 0.15}, time_of({}));
  EXPECT_EQ(noisy.kind, ModulusKind::kIterative);
  EXPECT_TRUE(says(noisy, "not good enough everywhere here")) << noisy.why;
}

TEST(ModulusPlan, IsCheaperWhereMoreIsAllowed) {
  EXPECT_EQ(plan_modulus({0.1, 0}, kQuiet, kEven, time_of({})).kind, ModulusKind::kReferenceStress);
  EXPECT_EQ(plan_modulus({0.1, 0}, kQuiet, kLump, time_of({})).kind, ModulusKind::kIterative);
  EXPECT_EQ(plan_modulus({0.1, 0}, kQuiet, kSoft, time_of({})).kind, ModulusKind::kIterative);
}

TEST(ModulusPlan, TakesTheBestThatTheTimeAllows) {
  EXPECT_EQ(plan_modulus(kUsual, kQuiet, kLump, time_of(0.11)).kind, ModulusKind::kIterative)
      << "it stops in time";
  for (const double left_s : {0.09, 0.001, -1.0}) {
    const ModulusPlan plan = plan_modulus(kUsual, kQuiet, kLump, time_of(left_s));
    EXPECT_EQ(plan.kind, ModulusKind::kReferenceStress);
    EXPECT_TRUE(says(plan, "left of the 0.50 s of a window, and the iterative")) << plan.why;
  }
}

// GIVEN a square of 15 mm that is twice as stiff, and noise, THEN what is seen is that, and a corner alone is
// not.
TEST(ModulusPlan, SeesWhatAFingerFeels) {
  const ImageGrid grid{120, 80, 0, 0, 0.0005, 0.0005};
  Field modulus(grid.size(), 1e4F);
  for (std::size_t n = 0; n < grid.size(); ++n) modulus[n] *= n % 2 == 0 ? 1.1F : 1 / 1.1F;
  const Unevenness even = unevenness(modulus, 1e4, grid);
  EXPECT_NEAR(even.stiff, 0, 1e-3);
  EXPECT_NEAR(even.soft, 0, 1e-3);
  for (std::size_t n = 0; n < grid.size(); ++n)
    if (grid.x_m(n) > 0.02 && grid.x_m(n) < 0.04 && grid.y_m(n) < 0.02) modulus[n] *= 2;
  modulus[0] = std::numeric_limits<float>::quiet_NaN();
  const Unevenness lump = unevenness(modulus, 1e4, grid);
  EXPECT_NEAR(lump.stiff, std::log(2), 0.05);
  EXPECT_NEAR(lump.soft, 0, 1e-3);
  EXPECT_GT(expected_error(ModulusKind::kReferenceStress, lump, 0),
            expected_error(ModulusKind::kIterative, lump, 0));
  const Field nothing(grid.size(), std::numeric_limits<float>::quiet_NaN());
  EXPECT_EQ(unevenness(nothing, 1e4, grid).stiff, 0);
}

}  // namespace
}  // namespace teletact::service
