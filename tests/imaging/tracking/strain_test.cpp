#include "service/imaging/tracking/measured.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/imaging/imaging_device.h"
#include "tests/reference/strain.h"

namespace teletact::service {
namespace {

struct Case {
  ImageGrid grid;
  reference::DisplacementField field;
  DisplacementEstimate on_device;
};

Case make_case(const Queue& queue, std::size_t nx, std::size_t ny, double noise_m, double distrusted) {
  Case c;
  c.grid = {nx, ny, 0, 0, 0.47e-3, 0.4e-3};
  c.field = {static_cast<int>(nx), static_cast<int>(ny), c.grid.dx_m, c.grid.dy_m, {}, {}, {}};
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<float> field;
  std::vector<std::uint8_t> trusted;
  for (std::size_t n = 0; n < c.grid.size(); ++n) {
    const double x = static_cast<double>(n % nx) * c.grid.dx_m, y = static_cast<double>(n / nx) * c.grid.dy_m;
    field.push_back(static_cast<float>(0.012 * x + 0.004 * y + noise_m * normal(random)));
    field.push_back(static_cast<float>(1.1e-3 - 0.03 * y - 0.006 * x + noise_m * normal(random)));
    trusted.push_back(uniform(random) >= distrusted ? 1 : 0);
    c.field.lateral.push_back(field[2 * n]);
    c.field.axial.push_back(field[2 * n + 1]);
    c.field.trusted.push_back(trusted.back());
  }
  c.on_device.field_m = queue.array(field);
  c.on_device.trusted = queue.array(trusted);
  return c;
}

StrainOptions kernel_of(int half_columns, int half_rows) {
  StrainOptions options;
  options.kernel_lateral_m = 2 * half_columns * 0.47e-3;
  options.kernel_axial_m = 2 * half_rows * 0.4e-3;
  return options;
}

TEST(Strain, MatchesReferenceWithDistrustedNodes) {
  const Queue queue = imaging_device()->queue();
  const Case c = make_case(queue, 23, 31, 2e-6, 0.3);
  StrainEstimator estimator(queue, kernel_of(2, 3));
  const StrainEstimate got = estimator.estimate(c.on_device, c.grid);
  const std::vector<float> tensor = queue.read(got.tensor);
  const std::vector<std::uint8_t> trusted = queue.read(got.trusted);
  int determined = 0;
  for (int n = 0; n < 23 * 31; ++n) {
    const auto want = reference::least_squares_strain(c.field, n % 23, n / 23, 2, 3, 0.6);
    const float* const t = tensor.data() + 4 * n;
    ASSERT_EQ(want.determined, std::isfinite(t[1])) << n;
    if (!want.determined) {
      EXPECT_EQ(trusted[n], 0);
      continue;
    }
    ++determined;
    EXPECT_NEAR(t[0], want.lateral, 2e-5) << n;
    EXPECT_NEAR(t[1], want.axial, 2e-5) << n;
    EXPECT_NEAR(t[2], want.shear, 2e-5) << n;
    EXPECT_NEAR(t[3], want.residual_m, 5e-8) << n;
    EXPECT_EQ(trusted[n], c.field.trusted[n] && want.residual_m <= 6e-6) << n;
  }
  EXPECT_GT(determined, 23 * 31 / 2);
}

TEST(Strain, IsExactOnUniformStrainUpToTheBorder) {
  const Queue queue = imaging_device()->queue();
  const Case c = make_case(queue, 13, 17, 0, 0);
  StrainEstimator estimator(queue, kernel_of(2, 3));
  const std::vector<float> tensor = queue.read(estimator.estimate(c.on_device, c.grid).tensor);
  for (std::size_t n = 0; n < c.grid.size(); ++n) {
    EXPECT_NEAR(tensor[4 * n], 0.012, 2e-6);
    EXPECT_NEAR(tensor[4 * n + 1], -0.03, 2e-6);
    EXPECT_NEAR(tensor[4 * n + 2], -0.001, 2e-6);
  }
}

TEST(Strain, ResidualDistrustsAPeakHop) {
  const Queue queue = imaging_device()->queue();
  Case c = make_case(queue, 13, 17, 0, 0);
  std::vector<float> field = queue.read(c.on_device.field_m);
  field[2 * (6 + 13 * 8) + 1] += 100e-6f;
  c.on_device.field_m = queue.array(field);
  StrainEstimator estimator(queue, kernel_of(2, 3));
  const std::vector<std::uint8_t> trusted = queue.read(estimator.estimate(c.on_device, c.grid).trusted);
  EXPECT_EQ(trusted[6 + 13 * 8], 0);
  EXPECT_EQ(trusted[6 + 13 * 9], 0);
  EXPECT_EQ(trusted[1 + 13 * 2], 1);
}

TEST(Strain, GridOfOneRowIsNotDetermined) {
  const Queue queue = imaging_device()->queue();
  const Case c = make_case(queue, 9, 1, 0, 0);
  StrainEstimator estimator(queue, kernel_of(2, 3));
  for (const float v : queue.read(estimator.estimate(c.on_device, c.grid).tensor)) EXPECT_TRUE(std::isnan(v));
}

}  // namespace
}  // namespace teletact::service
