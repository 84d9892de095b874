// The standard deviations that strain states: axial, lateral and shear, against the scatter of what it finds.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <random>

#include "service/imaging/tracking/measured.h"
#include "tests/imaging/imaging_device.h"
#include "tests/imaging/speckle.h"

namespace teletact::service {
namespace {

constexpr const char* kNames[] = {"lateral", "axial", "shear"};

// Errors over their stated deviations of eps_xx, eps_yy, eps_xy.
struct Standardised {
  std::array<double, 3> squares{};
  double count = 0;
  void add(const float* tensor, const float* deviation, const std::array<double, 3>& truth) {
    for (std::size_t c = 0; c < 3; ++c) squares[c] += std::pow((tensor[c] - truth[c]) / deviation[c], 2);
    ++count;
  }
  void expect_one(double tolerance) const {
    for (std::size_t c = 0; c < 3; ++c) {
      const double scatter = std::sqrt(squares[c] / count);
      std::printf("%s strain: scatter over stated deviation %.2f\n", kNames[c], scatter);
      EXPECT_GE(scatter, 1 / (1 + tolerance)) << kNames[c];
      EXPECT_LE(scatter, 1 + tolerance) << kNames[c];
    }
  }
};

// A known field, and errors of each node's own, of another size in each direction: what is stated is then
// exact.
struct GivenField {
  static constexpr double kUnit[] = {0.235e-3, 0.019e-3}, kMedian[] = {50, 80}, kInformation[] = {25, 640};
  static constexpr std::size_t kColumns = 2, kRows = 3;  // half of the kernel
  ImageGrid grid{120, 90, 0, 0, 0.47e-3, 0.4e-3};
  std::vector<float> tensor, deviation;

  template <class Field>
  explicit GivenField(const Field& truth) {
    const Queue queue = imaging_device()->queue();
    NoiseStructure noise;
    for (std::size_t c = 0; c < 2; ++c) {
      noise.response[c] = NoiseResponse(SmootherResponse{0, 0, 3, 1}, kMedian[c], 1, 1);
      noise.unit_m[c] = kUnit[c];
    }
    std::mt19937 random(3);
    std::normal_distribution<double> normal;
    std::vector<float> field, information;
    for (std::size_t n = 0; n < grid.size(); ++n) {
      const std::array<double, 2> u = truth(grid.x_m(n), grid.y_m(n));
      for (std::size_t c = 0; c < 2; ++c) {
        field.push_back(static_cast<float>(u[c] + kUnit[c] / std::sqrt(kInformation[c]) * normal(random)));
        information.push_back(static_cast<float>(kInformation[c]));
      }
    }
    DisplacementEstimate displacement;
    displacement.field_m = queue.array(field);
    displacement.trusted = queue.array(std::vector<std::uint8_t>(grid.size(), 1));
    displacement.information = queue.array(information);
    displacement.noise = std::make_shared<NoiseStructure>(noise);
    StrainOptions options;
    options.kernel_lateral_m = 2 * kColumns * grid.dx_m;
    options.kernel_axial_m = 2 * kRows * grid.dy_m;
    options.residual_limit_m = 1;
    const StrainEstimate strain = StrainEstimator(queue, options).estimate(displacement, grid);
    tensor = queue.read(strain.tensor), deviation = queue.read(strain.std);
  }
  template <class Each>
  void for_each_inside(const Each& each) const {
    for (std::size_t j = kRows; j + kRows < grid.ny; ++j)
      for (std::size_t i = kColumns; i + kColumns < grid.nx; ++i) each(i + grid.nx * j);
  }
};

TEST(StrainDeviation, IsTheScatterOfIndependentErrors) {
  const GivenField given([](double, double) { return std::array{0.0, 0.0}; });
  Standardised some;
  given.for_each_inside([&](std::size_t n) {
    some.add(&given.tensor[4 * n], &given.deviation[4 * n], {0, 0, 0});
  });
  some.expect_one(0.2);
}

// Waves of strain, short beside the kernel, far above the noise: the error is all bias.
TEST(StrainDeviation, HoldsTheBiasOfTheKernel) {
  constexpr double kStrain = 0.2,
                   kWave = 800;  // rad / m: a kernel spans a third of a wave along, a half across
  const GivenField given([](double x, double y) {
    return std::array{kStrain / kWave * std::sin(kWave * x), kStrain / kWave * std::sin(kWave * y)};
  });
  std::array<double, 2> held{}, squares{};
  double count = 0;
  given.for_each_inside([&](std::size_t n) {
    ++count;
    const double truth[] = {kStrain * std::cos(kWave * given.grid.x_m(n)),
                            kStrain * std::cos(kWave * given.grid.y_m(n))};
    for (std::size_t c = 0; c < 2; ++c) {
      const double off = (given.tensor[4 * n + c] - truth[c]) / given.deviation[4 * n + c];
      held[c] += std::abs(off) < 1.96, squares[c] += off * off;
    }
  });
  for (std::size_t c = 0; c < 2; ++c) {
    EXPECT_GT(held[c] / count, 0.92) << kNames[c];
    EXPECT_GT(std::sqrt(squares[c] / count), 0.25) << kNames[c];
  }
  // What a model of the same kernel is weighed by holds none.
  EXPECT_LT(given.deviation[4 * given.grid.size() / 2 + 3],
            0.2 * given.deviation[4 * given.grid.size() / 2 + 1]);
}

// Through RF with noise and decorrelation, tissue under uniform strain and shear.
TEST(StrainDeviation, IsTheScatterOverPairs) {
  constexpr double kLateral = 0.004, kAxial = -0.01, kShear = 0.002;  // kShear: d u_x / dy = d u_y / dx
  const Queue queue = imaging_device()->queue();
  DisplacementEstimator displacement(queue, {});
  StrainEstimator estimator(queue, {});
  Standardised some;
  for (unsigned seed = 1; seed <= 6; ++seed) {
    SpeckleOptions options;
    options.samples = 1000;
    options.lines = 80;
    options.snr_db = 30;
    options.correlation = 0.98;
    options.scatterers_per_mm2 = 60;
    options.seed = seed;
    const Speckle speckle(options);
    const double width = static_cast<double>(options.lines) * speckle.geometry().line_pitch_m;
    const double depth = static_cast<double>(options.samples) * speckle.geometry().sample_pitch_m();
    const RfFrame pre = speckle.frame([](double, double) { return std::pair{0.0, 0.0}; }, 1);
    const RfFrame post = speckle.frame(
        [=](double x, double y) {
          return std::pair{kLateral * (x - width / 2) + kShear * y, kAxial * y + kShear * (x - width / 2)};
        },
        2);
    const DisplacementEstimate found = displacement.estimate(pre, post, speckle.geometry());
    const ImageGrid grid = image_grid(found.grid, speckle.geometry());
    const StrainEstimate strain = estimator.estimate(found, grid);
    const std::vector<float> tensor = queue.read(strain.tensor), deviation = queue.read(strain.std);
    for (std::size_t n = 0; n < grid.size(); ++n) {
      const double x = grid.origin_x_m + static_cast<double>(n % grid.nx) * grid.dx_m;
      const double y = grid.origin_y_m + static_cast<double>(n / grid.nx) * grid.dy_m;
      if (std::min({x, y, width - x, depth - y}) < 3e-3) continue;
      some.add(&tensor[4 * n], &deviation[4 * n], {kLateral, kAxial, kShear});
    }
  }
  some.expect_one(0.35);
}

}  // namespace
}  // namespace teletact::service
