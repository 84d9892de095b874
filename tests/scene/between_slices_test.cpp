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

// What a finger feels of a field beyond the slices' planes, summed over pieces of 1 mm.
double felt_across(const ExplicitModulus& e, const FeltPlace& place,
                   const std::function<double(std::size_t, double)>& of) {
  constexpr double kPieceM = 1e-3, kFarM = 0.02;
  const FeltElements felt(e.x_m, e.y_m, place);
  double sum = 0;
  felt.each([&](std::size_t element, double share) {
    const std::size_t row = element / 24;
    if (share < 1e-3) return;
    for (double z_m = -kFarM; z_m < kFarM; z_m += kPieceM)
      if (const double borne = felt.before(row, z_m + kPieceM) - felt.before(row, z_m); borne > 3e-3)
        sum += share * borne * of(element, z_m + kPieceM / 2);
  });
  return sum;
}

double interpolated(const ExplicitModulus& e, std::size_t element, double z_m) {
  const Between at = between(e, z_m);
  return (1 - at.share) * std::log(e.youngs_modulus_pa[element + 240 * at.before] / 1e4) +
         at.share * std::log(e.youngs_modulus_pa[element + 240 * at.after] / 1e4);
}

// By hand: at a slice, amid, beyond, and with one more, of slices that differ by ln 2 and hide 0.2.
TEST(BetweenSlices, AFingerFeelsWhatLiesAllAroundIt) {
  constexpr double kFirstM = -0.0024, kMoreM = 0.0006, kLastM = 0.0026, kFarM = 0.4;
  const auto step = [](const Place& at) { return at[2] > 0 ? std::numbers::ln2 : 0.0; };
  ExplicitModulus e = stacked(grid(), {cut(step, kFirstM), cut(step, kLastM)}, {});
  std::fill(e.hidden_log_variance.begin(), e.hidden_log_variance.end(), 0.04);
  // Of what a row bears from place to place: so often a piece.
  const auto sum_of = [](const FeltElements& felt, std::size_t row, double from_m, double to_m,
                         const auto& of) {
    constexpr int kPieces = 400;
    const double piece_m = (to_m - from_m) / kPieces;
    double sum = 0;
    for (int k = 0; k < kPieces; ++k)
      sum += (felt.before(row, from_m + (k + 1) * piece_m) - felt.before(row, from_m + k * piece_m)) *
             of(from_m + (k + 0.5) * piece_m);
    return sum;
  };
  const auto unknown = [](double away_m) {
    return choices::kUnseenDeviation * std::min(1.0, away_m / choices::kSliceReach);
  };
  for (const bool one_more : {false, true})
    for (const double radius_m : {0.001, 0.004})
      for (const double z_m : {-0.012, kFirstM, 0.0001, 0.0013, kLastM}) {
        const FeltPlace place{kBallX, 0, z_m, radius_m};
        const FeltElements felt(e.x_m, e.y_m, place);
        const double as_small = left_of_local(radius_m, choices::kSliceReach);
        std::vector<double> of_row(10, 0.0);
        for (std::size_t row = 0; row < 10; ++row) {
          const auto within = [&](double from_m, double to_m) {
            const double half_m = (to_m - from_m) / 2, share = 2 * half_m / (kLastM - kFirstM);
            const double amid = sum_of(felt, row, from_m, to_m, [&](double z) {
              return 0.2 * share * (1 - std::abs(z - from_m - half_m) / half_m);
            });
            // The tissue may change at each of 400 places.
            double sum = 0, squares = 0;
            for (int k = 0; k < 400; ++k) {
              const double beyond =
                  felt.before(row, to_m) - felt.before(row, from_m + 2 * half_m * (k + 0.5) / 400);
              sum += beyond / 400, squares += beyond * beyond / 400;
            }
            return as_small * (amid * amid + (squares - sum * sum) * std::pow(share * std::numbers::ln2, 2));
          };
          of_row[row] = one_more ? within(kFirstM, kMoreM) + within(kMoreM, kLastM) : within(kFirstM, kLastM);
          const double left =
                           sum_of(felt, row, -kFarM, kFirstM, [&](double z) { return unknown(kFirstM - z); }),
                       right =
                           sum_of(felt, row, kLastM, kFarM, [&](double z) { return unknown(z - kLastM); });
          of_row[row] += left * left + right * right;
        }
        double expected = 0;
        felt.each([&](std::size_t element, double share) { expected += share * of_row[element / 24]; });
        const double found =
            one_more ? felt_between_variance(e, felt, kMoreM) : felt_between_variance(e, felt);
        EXPECT_NEAR(std::sqrt(found), std::sqrt(expected), 0.005)
            << radius_m << ' ' << z_m << ' ' << one_more;
      }
}

// A point of a finger feels what its elements do, and no more than those.
TEST(BetweenSlices, APointFeelsItsOwnPlace) {
  // One row, so thin that it is all that is felt.
  const auto at = [](double half_gap_m, double z_m) {
    ExplicitModulus thin = grid();
    thin.y_m = {0, 1e-9}, thin.slices_m = {-half_gap_m, half_gap_m};
    for (const double pa : {1e4, 2e4}) thin.youngs_modulus_pa.insert(thin.youngs_modulus_pa.end(), 24, pa);
    thin.hidden_log_variance = {0.04};
    return felt_between_variance(thin, {thin.x_m, thin.y_m, {kBallX, 0, z_m, 1e-6}});
  };
  const double differ = std::pow(std::numbers::ln2, 2);
  EXPECT_NEAR(at(0.0025, 0), 0.25 * differ + 0.04, 1e-3);
  EXPECT_NEAR(at(0.0025, -0.00125), 0.1875 * differ + 0.01, 0.06 * differ) << "by eight places";
  EXPECT_NEAR(at(0.0025, 0.0025), 0, 1e-4);
  EXPECT_NEAR(at(0.0025, -0.00375), unknown(0.00125), 1e-3);
  EXPECT_NEAR(at(0.0025, 0.015), unknown(choices::kSliceReach), 1e-3)
      << "no more than of what nobody measured";
  EXPECT_NEAR(at(0.006, 0), 0.25 * differ + unknown(choices::kSliceReach), 1e-3) << "amid a wide gap";
}

// What one more slice leaves is foretold where it tells nothing of its own: as when it is there.
TEST(BetweenSlices, OneMoreIsForetold) {
  const auto step = [](const Place& at) { return at[2] > 0.002 ? std::numbers::ln2 : 0.0; };
  const ExplicitModulus e = stacked(grid(), {cut(step, -0.003), cut(step, 0.005)}, {});
  for (const double more_m : {-0.0125, 0.0125})  // as far as nothing is told in between
    for (const double z_m : {-0.014, -0.008, 0.001, 0.009}) {
      const FeltElements felt(e.x_m, e.y_m, {kBallX, 0, z_m, 0.004});
      const ExplicitModulus grown = with_slice(e, cut(step, more_m), {}).modulus;
      const double foretold = felt_between_variance(e, felt, more_m);
      EXPECT_NEAR(foretold, felt_between_variance(grown, felt), 1e-9) << more_m << ' ' << z_m;
      EXPECT_LE(foretold, felt_between_variance(e, felt)) << more_m << ' ' << z_m;
    }
}

// Of fingers on tissues that are known throughout, by the seeds of their kind: the share of places that what
// is stated holds, and its root mean square over what is missed.
struct FeltHeld {
  double share, wider;
};
FeltHeld felt_held(const std::function<LogModulus(unsigned)>& kind, double radius_m) {
  double inside = 0, count = 0, stated = 0, missed = 0;
  for (const unsigned seed : {1u, 2u, 3u}) {
    const LogModulus tissue = kind(seed);
    const ExplicitModulus e = cut(tissue);
    for (const double x_m : {0.009, 0.020, 0.031})
      for (const double z_m : {-0.0075, -0.001, 0.0, 0.0025, 0.006}) {
        const FeltPlace place{x_m, 0, z_m, radius_m};
        const double off = felt_across(e, place, [&](std::size_t n, double z) {
          const double x = (e.x_m[n % 24] + e.x_m[n % 24 + 1]) / 2,
                       y = (e.y_m[n / 24] + e.y_m[n / 24 + 1]) / 2;
          return tissue({x, y, z}) - interpolated(e, n, z);
        });
        const double variance = felt_between_variance(e, {e.x_m, e.y_m, place});
        inside += off * off <= 1.96 * 1.96 * variance, ++count, stated += variance, missed += off * off;
      }
  }
  return {inside / count, std::sqrt(stated / missed)};
}

TEST(BetweenSlices, HoldWhatFingersFeelOfTissueThatIsKnownThroughout) {
  const auto textures = [](double size, const Place& length_m) {
    return [=](unsigned seed) { return texture(size, length_m, seed); };
  };
  const auto lumps = [](double radius_m, double size, int count) {
    return [=](unsigned seed) { return nodules(radius_m, size, count, seed); };
  };
  const std::array<std::function<LogModulus(unsigned)>, 5> kinds{
      textures(0.2, {0.006, 0.006, 0.006}), textures(0.1, {0.003, 0.003, 0.003}),
      textures(0.2, {0.020, 0.020, 0.003}),  // wrong alike over more than is taken for granted
      lumps(0.0024, 1.1, 40), lumps(0.006, 1.6, 4)};
  for (std::size_t n = 0; n < kinds.size(); ++n)
    for (const double radius_m : {0.001, 0.004}) {
      const FeltHeld found = felt_held(kinds[n], radius_m);
      EXPECT_GE(found.share, 0.95) << n << ' ' << radius_m;
      EXPECT_GT(found.wider, 1) << n << ' ' << radius_m;
    }
}

}  // namespace
}  // namespace teletact::service
