// Hostile answers, contact laws and readings through the link's conversion and the servo loop, with every
// renderer.
#include "bench/fuzz/fuzz.h"

#include <gtest/gtest.h>

namespace teletact::bench {
namespace {

TEST(Fuzz, BoundsHoldForAnyAnswersAndLaws) {
  constexpr std::size_t kCases = 2'000'000;
  const FuzzResult result = fuzz_forces(kCases, 20240611);
  EXPECT_EQ(result.cases, kCases);
  EXPECT_EQ(result.not_finite, 0u);
  EXPECT_EQ(result.too_large, 0u);
  EXPECT_EQ(result.too_fast, 0u);
  EXPECT_EQ(result.above_cap, 0u);
  EXPECT_EQ(result.grown, 0u);
  EXPECT_EQ(result.in_silence, 0u);
  EXPECT_EQ(result.overdrawn, 0u);
  ASSERT_EQ(result.renderers.size(), 5u);
  for (const FuzzShares& one : result.renderers) {
    EXPECT_GT(one.share(one.hostile_answers), 0.005) << one.renderer;
    EXPECT_GT(one.share(one.hostile_readings), 2e-4) << one.renderer;
    if (one.renderer == "law") {
      EXPECT_GT(one.share(one.hostile_laws), 1e-4);
      EXPECT_GE(one.share(one.by_law), FuzzShares::kByLawMin);
    }
    EXPECT_GE(one.share(one.non_zero), FuzzShares::kNonZeroMin) << one.renderer;
    EXPECT_GE(one.share(one.slew_limited), FuzzShares::kSlewLimitedMin) << one.renderer;
    EXPECT_GE(one.share(one.at_largest), FuzzShares::kAtLargestMin) << one.renderer;
    EXPECT_GE(one.again(), FuzzShares::kAgainMin) << one.renderer;
    EXPECT_GE(one.share(one.fading), FuzzShares::kFadingMin) << one.renderer;
    EXPECT_GE(one.share(one.silent), FuzzShares::kSilentMin) << one.renderer;
  }
}

}  // namespace
}  // namespace teletact::bench
