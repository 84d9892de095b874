// Contact laws over an area: lanes of columns.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "common/contact_law.h"

namespace teletact {
namespace {

// W = ln 50 + n s + 0.3 sin(80 x) cos(60 z), n = 2.4 + 0.2 sin(50 x + 40 z).
struct Tissue {
  double x, z;
  double power() const { return 2.4 + 0.2 * std::sin(50 * x + 40 * z); }
  double tilt() const { return 0.2 * std::cos(50 * x + 40 * z); }
  double energy(double d) const {
    return 50 * std::exp(0.3 * std::sin(80 * x) * std::cos(60 * z)) * std::pow(d, power());
  }
};

LawColumn column_at(double x, double z, double lane_before) {
  LawColumn column;
  column.x_m = x, column.z_m = z, column.lane_before_m = lane_before;
  column.of_area = true;
  const Tissue at{x, z};
  for (const double d : {3e-4, 9e-4, 2.7e-3, 8e-3}) {
    const double s = std::log(d);
    LawSample sample;
    sample.log_energy = float(std::log(at.energy(d)));
    sample.by_log_depth = float(at.power());
    sample.by_x_1_m = float(24 * std::cos(80 * x) * std::cos(60 * z) + 50 * at.tilt() * s);
    sample.by_z_1_m = float(-18 * std::sin(80 * x) * std::sin(60 * z) + 40 * at.tilt() * s);
    sample.mixed_1_m = float(50 * at.tilt());
    sample.by_zs_1_m = float(40 * at.tilt());
    const double curl = -0.2 * std::sin(50 * x + 40 * z) * 2000;
    sample.by_xz_1_m2 = float(-1440 * std::cos(80 * x) * std::sin(60 * z) + curl * s);
    sample.by_xzs_1_m2 = float(curl);
    column.log_depth[column.rows] = float(s);
    column.samples[column.rows++] = sample;
  }
  return column;
}

// Three lanes; the middle one has columns of its own.
std::vector<LawColumn> area() {
  std::vector<LawColumn> columns;
  for (const double x : {0.0, 0.005, 0.01, 0.015}) columns.push_back(column_at(x, 0.001, 0.001));
  for (const double x : {0.0, 0.004, 0.008, 0.012, 0.016}) columns.push_back(column_at(x, 0.006, 0.001));
  for (const double x : {0.0, 0.005, 0.01, 0.015}) columns.push_back(column_at(x, 0.010, 0.006));
  return columns;
}

TEST(AreaLaw, IsWhatWasSampledAtAndBetweenItsColumns) {
  const auto columns = area();
  for (double x = 0; x <= 0.015; x += 3.1e-4)
    for (double z = 0.001; z <= 0.010; z += 2.9e-4)
      for (double d = 2e-4; d < 0.008; d *= 1.7) {
        const LawValue value = evaluate(columns, x, d, z);
        ASSERT_TRUE(value.covered);
        constexpr double kStepM = 1e-7;
        const double u = Tissue{x, z}.energy(d);
        const double by_z =
            (Tissue{x, z + kStepM}.energy(d) - Tissue{x, z - kStepM}.energy(d)) / (2 * kStepM);
        const double by_d =
            (Tissue{x, z}.energy(d + kStepM) - Tissue{x, z}.energy(d - kStepM)) / (2 * kStepM);
        EXPECT_NEAR(value.energy_j / u, 1, 3e-3);
        EXPECT_NEAR(value.by_d_n / by_d, 1, 5e-3);
        EXPECT_NEAR(value.by_z_n, by_z, 0.02 * by_d);
      }
}

// Values that no tissue has, and lanes that share no column: the field is conservative all the same, and has
// no step where a cell ends.
TEST(AreaLaw, ForceIsTheGradientOfTheEnergyEverywhere) {
  auto columns = area();
  columns[1].samples[2].by_log_depth = 3.1F;
  columns[2].samples[1].by_xz_1_m2 = 9000;
  columns[5].samples[1].by_zs_1_m = 40;
  columns[6].rows = 3;
  columns[10].log_depth[1] += 0.4F;
  for (double x = 1e-4; x < 0.015; x += 3.7e-4)
    for (double z = 0.0011; z < 0.010; z += 3.1e-4)
      for (double d = 2e-4; d < 0.010; d *= 1.37) {
        constexpr double kStepM = 1e-8;
        const LawValue value = evaluate(columns, x, d, z);
        const LawValue right = evaluate(columns, x + kStepM, d, z),
                       left = evaluate(columns, x - kStepM, d, z);
        const LawValue below = evaluate(columns, x, d + kStepM, z),
                       above = evaluate(columns, x, d - kStepM, z);
        const LawValue after = evaluate(columns, x, d, z + kStepM),
                       before = evaluate(columns, x, d, z - kStepM);
        const double size = std::hypot(value.by_x_n, value.by_d_n, value.by_z_n);
        EXPECT_NEAR(value.by_x_n, (right.energy_j - left.energy_j) / (2 * kStepM), 1e-4 * size);
        EXPECT_NEAR(value.by_d_n, (below.energy_j - above.energy_j) / (2 * kStepM), 1e-4 * size);
        EXPECT_NEAR(value.by_z_n, (after.energy_j - before.energy_j) / (2 * kStepM), 1e-4 * size);
        EXPECT_NEAR(after.by_x_n, before.by_x_n, 1e-3 * size + 1e-4);
        EXPECT_NEAR(after.by_z_n, before.by_z_n, 1e-3 * size + 1e-4);
        EXPECT_NEAR(right.by_z_n, left.by_z_n, 1e-3 * size + 1e-4);
      }
}

TEST(AreaLaw, CoversNothingBesideItsLanesOrInGaps) {
  auto columns = area();
  const auto covered = [&](double x, double z) { return evaluate(columns, x, 0.001, z).covered; };
  EXPECT_FALSE(covered(0.007, 0.0009));
  EXPECT_TRUE(covered(0.007, 0.001));
  EXPECT_TRUE(covered(0.007, 0.010));
  EXPECT_FALSE(covered(0.007, 0.0101));
  EXPECT_FALSE(covered(0.0155, 0.005)) << "beside the lane before";
  EXPECT_FALSE(covered(0.007, std::numeric_limits<double>::quiet_NaN()));
  columns[6].joined = false;  // a column of the middle lane
  EXPECT_FALSE(covered(0.007, 0.005));
  EXPECT_FALSE(covered(0.007, 0.007));
  EXPECT_TRUE(covered(0.009, 0.005));
  EXPECT_TRUE(covered(0.009, 0.007));
  for (std::size_t i = 9; i < columns.size(); ++i) columns[i].lane_before_m = 0.008;  // a lane
  EXPECT_TRUE(covered(0.009, 0.005));
  EXPECT_FALSE(covered(0.009, 0.007));
}

TEST(AreaLaw, OneLaneCoversNothing) {
  std::vector<LawColumn> lane;
  for (const double x : {0.0, 0.005, 0.01}) lane.push_back(column_at(x, 0.001, 0.001));
  for (const double z : {0.0, 0.001, 0.002}) EXPECT_FALSE(evaluate(lane, 0.003, 0.001, z).covered);
  for (LawColumn& column : lane) column.of_area = false;  // a plane's
  for (const double z : {-1.0, 0.001, 1.0}) EXPECT_TRUE(evaluate(lane, 0.003, 0.001, z).covered);
}

TEST(AreaLaw, SaysTheWorstOfTheColumnsAroundAPlace) {
  auto columns = area();
  for (std::size_t i = 0; i < columns.size(); ++i) {
    columns[i].version = 7;
    columns[i].error_n = 0.001F;
  }
  columns[9].error_n = 0.004F;
  columns[9].corrected = false;
  const LawValue beside = evaluate(columns, 0.002, 0.002, 0.005);
  EXPECT_TRUE(beside.corrected);
  EXPECT_FLOAT_EQ(float(beside.error_n), 0.001F);
  const LawValue at = evaluate(columns, 0.002, 0.002, 0.008);
  EXPECT_FALSE(at.corrected);
  EXPECT_FLOAT_EQ(float(at.error_n - at.disagreement_n), 0.004F);
  for (LawSample& sample : columns[9].samples) sample.log_energy += 0.05F;
  EXPECT_GT(evaluate(columns, 0.002, 0.002, 0.008).disagreement_n, at.disagreement_n)
      << "a guess that is off";
  for (LawSample& sample : columns[9].samples) sample.log_energy -= 0.05F;
  columns[9].version = 8;
  const LawValue border = evaluate(columns, 0.002, 0.002, 0.008);
  EXPECT_EQ(border.oldest, 7);
  EXPECT_EQ(border.newest, 8);
  EXPECT_GT(border.disagreement_n, 0);
}

TEST(AreaLaw, IsUnusableWhereItsLanesAreInNoOrder) {
  LawColumn column = column_at(0.005, 0.006, 0.001);
  EXPECT_TRUE(usable(column));
  column.lane_before_m = 0.007;
  EXPECT_FALSE(usable(column));
  column.lane_before_m = 0.001;
  column.samples[1].by_xzs_1_m2 = std::numeric_limits<float>::infinity();
  EXPECT_FALSE(usable(column));
}

}  // namespace
}  // namespace teletact
