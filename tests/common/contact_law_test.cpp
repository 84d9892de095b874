#include "common/contact_law.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

namespace teletact {
namespace {

// U = k(x) d^2.4, k(x) = 50 (1 + 0.3 sin(80 x)), sampled with its exact derivatives.
LawColumn column_at(double x_m) {
  LawColumn column;
  column.x_m = x_m;
  const double k = 50 * (1 + 0.3 * std::sin(80 * x_m)), by_x = 50 * 0.3 * 80 * std::cos(80 * x_m);
  for (const double d : {3e-4, 9e-4, 2.7e-3, 8e-3}) {
    column.log_depth[column.rows] = float(std::log(d));
    column.samples[column.rows++] = {float(std::log(k) + 2.4 * std::log(d)), float(by_x / k), 2.4F, 0};
  }
  return column;
}

struct Law {
  std::array<LawColumn, 5> columns{column_at(0), column_at(0.005), column_at(0.009), column_at(0.015),
                                   column_at(0.02)};
  LawValue at(double x_m, double d_m) const { return evaluate(columns, x_m, d_m); }
};

TEST(ContactLaw, IsWhatWasSampledAtAndBetweenItsColumns) {
  const Law law;
  for (double x = 0; x <= 0.02; x += 3e-4)
    for (double d = 1e-4; d < 0.012; d *= 1.3) {
      const double k = 50 * (1 + 0.3 * std::sin(80 * x));
      const LawValue value = law.at(x, d);
      ASSERT_TRUE(value.covered);
      EXPECT_NEAR(value.energy_j / (k * std::pow(d, 2.4)), 1, 1e-3);
      EXPECT_NEAR(value.by_d_n / (2.4 * k * std::pow(d, 1.4)), 1, 1e-3);
      EXPECT_EQ(value.beyond, d > 8e-3);
    }
}

// Uneven rows, values that no tissue has: the field is conservative all the same, across every border of
// cells.
TEST(ContactLaw, ForceIsTheGradientOfTheEnergyEverywhere) {
  Law law;
  law.columns[1].samples[2].by_log_depth = 3.1F;
  law.columns[2].samples[1].mixed_1_m = 40;
  law.columns[2].rows = 3;
  law.columns[3].log_depth[1] += 0.4F;
  for (double x = 1e-4; x < 0.02; x += 1.7e-4)
    for (double d = 2e-4; d < 0.010; d *= 1.17) {
      constexpr double kStepM = 1e-8;
      const LawValue value = law.at(x, d), right = law.at(x + kStepM, d), left = law.at(x - kStepM, d),
                     below = law.at(x, d + kStepM), above = law.at(x, d - kStepM);
      const double size = std::hypot(value.by_x_n, value.by_d_n);
      EXPECT_NEAR(value.by_x_n, (right.energy_j - left.energy_j) / (2 * kStepM), 1e-4 * size);
      EXPECT_NEAR(value.by_d_n, (below.energy_j - above.energy_j) / (2 * kStepM), 1e-4 * size);
      // No step of the force, wherever a cell ends.
      EXPECT_NEAR(right.by_x_n, left.by_x_n, 1e-3 * size + 1e-4);
    }
}

TEST(ContactLaw, IsBeyondBesideAColumnThatEndsAbove) {
  Law law;
  law.columns[1].rows = 3;  // down to 2.7 mm, at 5 mm
  for (const double x : {0.002, 0.007}) {
    EXPECT_FALSE(law.at(x, 0.0026).beyond);
    EXPECT_TRUE(law.at(x, 0.0028).beyond);
  }
  EXPECT_FALSE(law.at(0.012, 0.0028).beyond);
}

TEST(ContactLaw, CoversNothingBesideItsColumnsNorWhereOneIsMissing) {
  Law law;
  EXPECT_FALSE(law.at(-1e-9, 0.001).covered);
  EXPECT_FALSE(law.at(0.0201, 0.001).covered);
  EXPECT_FALSE(law.at(std::numeric_limits<double>::quiet_NaN(), 0.001).covered);
  EXPECT_TRUE(law.at(0.007, 0.001).covered);
  law.columns[2].joined = false;
  EXPECT_FALSE(law.at(0.007, 0.001).covered);
  EXPECT_TRUE(law.at(0.010, 0.001).covered);
  EXPECT_FALSE(evaluate({}, 0, 0.001).covered);
}

TEST(ContactLaw, WhatOverflowsCoversNothing) {
  Law law;
  law.columns[1].samples[1].log_energy = 3e4F;
  law.columns[2].samples[2].by_x_1_m = 1e30F;
  std::size_t refused = 0;
  for (double x = 0; x <= 0.02; x += 1e-4)
    for (double d = 1e-4; d < 0.010; d *= 1.2) {
      const LawValue value = law.at(x, d);
      ASSERT_TRUE(std::isfinite(value.energy_j) && std::isfinite(value.by_x_n) &&
                  std::isfinite(value.by_d_n));
      refused += !value.covered;
    }
  EXPECT_GT(refused, 100u);
}

TEST(ContactLaw, OutOfContactIsNothing) {
  const Law law;
  for (const double d : {0.0, -0.001, -1e9, std::numeric_limits<double>::quiet_NaN()}) {
    const LawValue value = law.at(0.01, d);
    EXPECT_TRUE(value.covered);
    EXPECT_EQ(value.energy_j, 0);
    EXPECT_EQ(value.by_d_n, 0);
    EXPECT_EQ(value.by_x_n, 0);
  }
}

TEST(ContactLaw, StatesBothVersionsAndTheLargerError) {
  Law law;
  law.columns[0].version = 3, law.columns[1].version = 7;
  law.columns[1].error_share = 0.01F, law.columns[0].error_n = 0.002F;
  const LawValue value = law.at(0.002, 0.003);
  EXPECT_EQ(value.oldest, 3u);
  EXPECT_EQ(value.newest, 7u);
  EXPECT_NEAR(value.error_n - value.disagreement_n, 0.01 * std::hypot(value.by_x_n, value.by_d_n) + 0.002,
              1e-6);
  for (LawSample& sample : law.columns[1].samples) sample.log_energy += 0.5F;  // 65 % harder
  const LawValue apart = law.at(0.002, 0.003);
  EXPECT_GT(apart.disagreement_n, 0.2 * apart.by_d_n);
  law.columns[0].version = 7;
  EXPECT_EQ(law.at(0.002, 0.003).disagreement_n, 0);
}

TEST(ContactLaw, AColumnThatCannotBeIsNotUsable) {
  EXPECT_TRUE(usable(column_at(0)));
  const auto refused = [](auto change) {
    LawColumn column = column_at(0);
    change(column);
    return !usable(column);
  };
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  EXPECT_TRUE(refused([](LawColumn& c) { c.rows = 0; }));
  EXPECT_TRUE(refused([](LawColumn& c) { c.rows = LawColumn::kMaxRows + 1; }));
  EXPECT_TRUE(refused([](LawColumn& c) { c.x_m = HUGE_VAL; }));
  EXPECT_TRUE(refused([](LawColumn& c) { c.log_depth[2] = c.log_depth[1]; }));
  EXPECT_TRUE(refused([](LawColumn& c) { c.samples[3].by_log_depth = 0; }));
  EXPECT_TRUE(refused([](LawColumn& c) { c.samples[3].log_energy = c.samples[2].log_energy; }));
  EXPECT_TRUE(refused([](LawColumn& c) { c.samples[0].log_energy = kNan; }));
  EXPECT_TRUE(refused([](LawColumn& c) { c.samples[1].by_x_1_m = kNan; }));
  EXPECT_TRUE(refused([](LawColumn& c) { c.samples[2].mixed_1_m = -HUGE_VALF; }));
  EXPECT_TRUE(refused([](LawColumn& c) { c.error_share = -0.1F; }));
  EXPECT_TRUE(refused([](LawColumn& c) { c.error_share = 1.1F; }));
  EXPECT_TRUE(refused([](LawColumn& c) { c.error_n = kNan; }));
}

}  // namespace
}  // namespace teletact
