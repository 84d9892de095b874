// What lies between slices: by hand, and against tissue that is known throughout.
#include "service/scene/between_slices.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>

#include "service/base/choices.h"
#include "tests/scene/stacks.h"

namespace teletact::service {
namespace {

using Place = std::array<double, 3>;                     // m: x, y, z
using LogModulus = std::function<double(const Place&)>;  // over that of 10 kPa

constexpr double kGapM = 0.005;

ModulusSlice cut(const LogModulus& tissue, double z_m) {
  ModulusSlice slice{z_m, {}, {}, {}};
  for (int j = 0; j < 10; ++j)
    for (int i = 0; i < 24; ++i)
      slice.youngs_modulus_pa.push_back(1e4 * std::exp(tissue({0.002 * (i + 0.5), 0.003 * (j + 0.5), z_m})));
  return slice;
}

ExplicitModulus cut(const LogModulus& tissue) {
  std::vector<ModulusSlice> slices;
  for (int k = 0; k < 8; ++k) slices.push_back(cut(tissue, kGapM * (k - 3.5)));
  return stacked(grid(), slices, {});
}

double unknown(double half_m) {
  return std::pow(choices::kUnseenDeviation * half_m / choices::kSliceReach, 2);
}

TEST(BetweenSlices, WhatChangesWithinThemChangesBetweenThem) {
  // From element to element, half a gap apart.
  const auto stripes = [](const Place& at) {
    return at[0] / 0.002 - std::floor(at[0] / 0.004) * 2 < 1 ? 0.1 : -0.1;
  };
  const ExplicitModulus e = stacked(grid(), {cut(stripes, -0.002), cut(stripes, 0.002)}, {});
  ASSERT_EQ(e.hidden_log_variance.size(), 10u);
  // By hand: the middle is 0.2 beside both, at 8.4 places in each slice; one place stands for the unknown.
  const double places = 1.8 * (kWidthM - 0.004) / choices::kSliceReach;
  for (const double variance : e.hidden_log_variance)
    EXPECT_NEAR(variance, (places * 0.04 + unknown(0.002)) / (places + 1), 1e-12);
}

TEST(BetweenSlices, WhatChangesFasterFromSliceToSliceIsSeen) {
  const auto layers = [](double size) {
    return [size](const Place& at) { return size * (std::lround(at[2] / kGapM + 3.5) % 2 == 0 ? 1 : -1); };
  };
  const double even = cut(layers(0)).hidden_log_variance[0], uneven = cut(layers(0.2)).hidden_log_variance[0];
  EXPECT_LT(even, 0.02 * unknown(kGapM / 2)) << "nothing changes anywhere";
  // A slice is 0.4 beside those 5 mm from it; within half of that, half as much.
  EXPECT_NEAR(uneven, 0.04, 0.008);
}

TEST(BetweenSlices, ASliceMoreThatShowsNothingNewLeavesNoMoreOpen) {
  const auto even = [](const Place&) { return 0.0; };
  std::vector<ModulusSlice> slices{cut(even, -0.005), cut(even, 0)};
  double before = HUGE_VAL;
  for (const double z_m : {0.005, 0.010, -0.010, -0.015}) {
    const double variance = stacked(grid(), slices, {}).hidden_log_variance.back();
    EXPECT_LT(variance, before) << z_m;
    before = variance;
    slices.push_back(cut(even, z_m));
  }
}

TEST(BetweenSlices, OfOneOrOfNarrowOnesNothingIsKnown) {
  EXPECT_TRUE(stacked(grid(), {slice_at(0)}, {}).hidden_log_variance.empty());
  ExplicitModulus narrow;
  narrow.x_m = {0, 0.001, 0.002, 0.003}, narrow.y_m = {0, 0.001}, narrow.z_m = narrow.slices_m = {0, 0.004};
  narrow.youngs_modulus_pa.assign(6, 1e4);
  ASSERT_EQ(hidden_log_variance(narrow).size(), 1u);
  EXPECT_NEAR(hidden_log_variance(narrow)[0], unknown(0.002), 1e-12);
}

// Cosines whose wave numbers are normal by 1 / length.
LogModulus texture(double size, const Place& length_m, unsigned seed) {
  constexpr int kWaves = 200;
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> angle(0, 2 * std::numbers::pi);
  std::vector<std::array<double, 4>> waves(kWaves);
  for (auto& wave : waves)
    wave = {normal(random) / length_m[0], normal(random) / length_m[1], normal(random) / length_m[2],
            angle(random)};
  return [=](const Place& at) {
    double sum = 0;
    for (const auto& w : waves) sum += std::cos(w[0] * at[0] + w[1] * at[1] + w[2] * at[2] + w[3]);
    return size * std::sqrt(2.0 / kWaves) * sum;
  };
}

LogModulus nodules(double radius_m, double size, int count, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> along(0, kWidthM), down(0, kDepthM), across(-0.018, 0.018);
  std::vector<Place> middles(count);
  for (Place& at : middles) at = {along(random), down(random), across(random)};
  return [=](const Place& at) {
    for (const Place& m : middles)
      if (std::hypot(at[0] - m[0], at[1] - m[1], at[2] - m[2]) < radius_m) return size;
    return 0.0;
  };
}

// Shares of the elements in the gaps' middles that what is stated holds, by a 95 % interval; and its root
// mean square over that of the prior alone.
struct Held {
  double share, narrower;
};
Held held(const LogModulus& tissue) {
  const ExplicitModulus e = cut(tissue);
  double inside = 0, count = 0, sum = 0;
  for (std::size_t gap = 0; gap + 1 < e.slices(); ++gap) {
    const double middle_m = (e.slices_m[gap] + e.slices_m[gap + 1]) / 2;
    const ModulusSlice truth = cut(tissue, middle_m);
    for (std::size_t n = 0; n < 240; ++n) {
      const double a = std::log(e.youngs_modulus_pa[n + 240 * gap]),
                   b = std::log(e.youngs_modulus_pa[n + 240 * (gap + 1)]),
                   off = std::log(truth.youngs_modulus_pa[n]) - (a + b) / 2,
                   hidden = e.hidden_log_variance[n / 24 + 10 * gap];
      inside += std::abs(off) <= 1.96 * std::sqrt((a - b) * (a - b) / 4 + hidden), ++count, sum += hidden;
    }
  }
  return {inside / count, std::sqrt(sum / count / unknown(kGapM / 2))};
}

TEST(BetweenSlices, HoldTissueThatIsKnownThroughout) {
  const std::array<double, 3> alike{0.006, 0.006, 0.006}, faster{0.006, 0.006, 0.003},
      fine{0.003, 0.003, 0.003};
  const std::array tissues{texture(0.2, alike, 1), texture(0.2, faster, 2), texture(0.1, fine, 3),
                           nodules(0.0024, 1.1, 40, 4), nodules(0.006, 1.6, 4, 5)};
  for (std::size_t n = 0; n < tissues.size(); ++n) {
    const auto [share, narrower] = held(tissues[n]);
    EXPECT_GE(share, 0.97) << n;
    EXPECT_LT(narrower, 0.7) << n;
  }
}

}  // namespace
}  // namespace teletact::service
