// How near the displacement comes to what physics allows, and whether it knows its own error.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>

#include "service/imaging/tracking/displacement.h"
#include "tests/imaging/imaging_device.h"
#include "tests/imaging/speckle.h"
#include "tests/imaging/tracking/stiff_inclusion.h"

namespace teletact::service {
namespace {

constexpr double kSnrDb = 30, kCorrelation = 0.99;

// T2.5 in its integral form: the least standard deviation (m) of the shift of one kernel `length_s` long on
// one A-line, var_t >= 1 / (2 T Int (2 pi f)^2 g^2 / (1 - g^2) df), g = rho / (1 + noise / signal), for the
// Gaussian echoes of Speckle and noise that is white up to half the sampling frequency.
double bound_m(double length_s) {
  const AcquisitionGeometry g = speckle_geometry();
  const double band = 0.5 * g.sampling_frequency_hz, f0 = g.center_frequency_hz;
  const double width = SpeckleOptions{}.fractional_bandwidth * f0 / (2 * std::sqrt(2 * std::log(2.0)));
  const double noise = std::pow(10, -kSnrDb / 10) / band, peak = 1 / (width * std::sqrt(std::numbers::pi));
  double integral = 0;
  constexpr int kSteps = 4000;
  for (int n = 0; n < kSteps; ++n) {
    const double f = band * (n + 0.5) / kSteps;
    const double coherence = kCorrelation / (1 + noise / (peak * std::exp(-std::pow((f - f0) / width, 2))));
    const double squared = coherence * coherence;
    integral += std::pow(2 * std::numbers::pi * f, 2) * squared / (1 - squared) * band / kSteps;
  }
  return g.sound_speed_m_s / 2 * std::sqrt(1 / (2 * length_s * integral));
}

SpeckleOptions noisy(unsigned seed) {
  SpeckleOptions o;
  o.snr_db = kSnrDb;
  o.correlation = kCorrelation;
  o.seed = seed;
  o.scatterers_per_mm2 = 60;
  return o;
}

// Regularised over the image, a shift has less error than any one kernel could have, and no bias.
TEST(Accuracy, RigidShiftsAreBelowTheBoundOfOneKernel) {
  const Queue queue = imaging_device()->queue();
  DisplacementEstimator estimator(queue, {});
  const double sample_m = speckle_geometry().sample_pitch_m(),
               length_s = 88 / 40e6;  // 1.6 mm in eights of samples
  const double bound = bound_m(length_s);
  double worst = 0, worst_bias = 0;
  for (int phase = 0; phase < 16; ++phase) {
    SpeckleOptions options = noisy(static_cast<unsigned>(phase) + 1);
    options.samples = 1200;
    options.lines = 96;
    const Speckle speckle(options);
    const double shift_m = sample_m * phase / 16;
    const RfFrame pre = speckle.frame([](double, double) { return std::pair{0.0, 0.0}; }, 1);
    const RfFrame post = speckle.frame([=](double, double) { return std::pair{0.0, shift_m}; }, 2);
    const DisplacementEstimate e = estimator.estimate(pre, post, speckle.geometry());
    const std::vector<float> u = queue.read(e.field_m);
    double sum = 0, squares = 0, count = 0;
    for (int n = 0; n < e.grid.nodes(); ++n) {
      const int i = n % e.grid.nx, sample = e.grid.first_sample + n / e.grid.nx * e.grid.sample_step;
      if (i < 3 || i >= e.grid.nx - 3 || sample < 80 || sample > 1120) continue;
      const double error = u[2 * static_cast<std::size_t>(n) + 1] - shift_m;
      sum += error, squares += error * error, ++count;
    }
    const double rmse = std::sqrt(squares / count), bias = sum / count;
    EXPECT_LE(rmse, bound) << phase;
    EXPECT_LE(std::abs(bias), 0.1e-6) << phase;
    worst = std::max(worst, rmse), worst_bias = std::max(worst_bias, std::abs(bias));
  }
  std::printf("rigid shifts: bound %.3f um, worst RMSE %.3f um = %.2f of it, worst |bias| %.3f um\n",
              1e6 * bound, 1e6 * worst, worst / bound, 1e6 * worst_bias);
}

struct Standardised {
  double squares[2][2]{}, count[2]{};  // [inside, outside][lateral, axial]
  double deviation(int outside, int axial) const {
    return std::sqrt(squares[outside][axial] / count[outside]);
  }
};

// Errors over their stated standard deviations, 1 mm from the inclusion's edge and 2 mm from the frame's.
void standardise(Standardised& s, const Queue& queue, DisplacementEstimator& estimator,
                 const SpeckleOptions& options, double strain) {
  const Speckle speckle(options);
  const StiffInclusion truth{strain, 3, 5e-3, 15e-3, 15e-3};
  const RfFrame pre = speckle.frame([](double, double) { return std::pair{0.0, 0.0}; }, 1);
  const RfFrame post = speckle.frame([&](double x, double y) { return truth.at(x, y); }, 2);
  const DisplacementEstimate e = estimator.estimate(pre, post, speckle.geometry());
  const ImageGrid grid = image_grid(e.grid, speckle.geometry());
  const std::vector<float> u = queue.read(e.field_m), deviation = queue.read(e.std_m);
  const double width = static_cast<double>(options.lines) * speckle.geometry().line_pitch_m;
  const double depth = static_cast<double>(options.samples) * speckle.geometry().sample_pitch_m();
  for (std::size_t n = 0; n < grid.size(); ++n) {
    const double x = grid.origin_x_m + static_cast<double>(n % grid.nx) * grid.dx_m;
    const double y = grid.origin_y_m + static_cast<double>(n / grid.nx) * grid.dy_m;
    const double r = std::hypot(x - truth.x_m, y - truth.y_m);
    if (std::min({x, y, width - x, depth - y}) < 2e-3 || std::abs(r - truth.radius_m) < 1e-3) continue;
    const int outside = r > truth.radius_m ? 1 : 0;
    const auto [ux, uy] = truth.at(x, y);
    s.squares[outside][0] += std::pow((u[2 * n] - ux) / deviation[2 * n], 2);
    s.squares[outside][1] += std::pow((u[2 * n + 1] - uy) / deviation[2 * n + 1], 2);
    ++s.count[outside];
  }
}

// Acceptance 1b, at every condition of noise, decorrelation and strain.
TEST(Accuracy, StandardisedErrorsHaveUnitVariance) {
  const Queue queue = imaging_device()->queue();
  DisplacementEstimator estimator(queue, {});
  for (const auto& [snr_db, correlation, strain] : {std::tuple{30.0, 0.99, -0.01},
                                                    {20.0, 0.98, -0.02},
                                                    {15.0, 0.95, -0.01},
                                                    {40.0, 0.98, -0.005},
                                                    {30.0, 0.9, -0.01}}) {
    Standardised some;
    for (unsigned seed = 1; seed <= 3; ++seed) {
      SpeckleOptions options = noisy(seed);
      options.samples = 1559;
      options.lines = 128;
      options.snr_db = snr_db;
      options.correlation = correlation;
      standardise(some, queue, estimator, options, strain);
    }
    std::printf(
        "%.0f dB, rho %.2f, strain %.1f %%: standardised errors inside %.2f lateral %.2f axial, outside "
        "%.2f, %.2f\n",
        snr_db, correlation, 100 * strain, some.deviation(0, 0), some.deviation(0, 1), some.deviation(1, 0),
        some.deviation(1, 1));
    for (int outside = 0; outside < 2; ++outside) {
      for (int axial = 0; axial < 2; ++axial) {
        EXPECT_GE(some.deviation(outside, axial), 0.8) << snr_db;
        EXPECT_LE(some.deviation(outside, axial), 1.2) << snr_db;
      }
    }
  }
}

}  // namespace
}  // namespace teletact::service
