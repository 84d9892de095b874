// What the whole displacement estimate promises, on synthetic speckle.
#include "service/imaging/tracking/displacement.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "service/imaging/tracking/measured.h"
#include "tests/imaging/imaging_device.h"
#include "tests/imaging/speckle.h"

namespace teletact::service {
namespace {

struct Errors {
  std::vector<double> axial_m, lateral_m;  // signed, of the trusted nodes away from the border
  double trusted_fraction = 0;
  // Axially off by a quarter wavelength or more, trusted or not, a coarse window away from the sides.
  double hop_fraction = 0;
  int trusted_hops = 0;  // of all nodes
  double median_axial() const { return quantile(axial_m, 0.5); }
  double quantile_axial(double q) const { return quantile(axial_m, q); }
  double quantile_lateral(double q) const { return quantile(lateral_m, q); }
  static double quantile(std::vector<double> v, double q) {
    if (v.empty()) return std::numeric_limits<double>::quiet_NaN();
    for (double& e : v) e = std::abs(e);
    const auto at = v.begin() + static_cast<std::ptrdiff_t>(q * static_cast<double>(v.size() - 1));
    std::nth_element(v.begin(), at, v.end());
    return *at;
  }
  double bias_axial() const {
    double sum = 0;
    for (const double e : axial_m) sum += e / static_cast<double>(axial_m.size());
    return sum;
  }
};

constexpr double kBorderM = 1e-3;

Errors track(const SpeckleOptions& speckle_options, const Motion& motion,
             const DisplacementOptions& options = {}, DisplacementFrame frame = DisplacementFrame::kProbe) {
  const Speckle speckle(speckle_options);
  const RfFrame pre = speckle.frame([](double, double) { return std::pair{0.0, 0.0}; }, 1);
  const RfFrame post = speckle.frame(motion, 2);
  const Queue queue = imaging_device()->queue();
  DisplacementEstimator estimator(queue, options);
  AcquisitionGeometry geometry = speckle.geometry();
  geometry.frame = frame;
  const DisplacementEstimate estimate = estimator.estimate(pre, post, geometry);
  const ImageGrid grid = image_grid(estimate.grid, speckle.geometry());
  const std::vector<float> field = queue.read(estimate.field_m);
  const std::vector<std::uint8_t> trusted = queue.read(estimate.trusted);
  const double width = static_cast<double>(pre.line_count) * speckle.geometry().line_pitch_m;
  const double depth = static_cast<double>(pre.sample_count) * speckle.geometry().sample_pitch_m();
  Errors errors;
  double inside = 0;
  for (std::size_t n = 0; n < grid.size(); ++n) {
    const double x = grid.origin_x_m + static_cast<double>(n % grid.nx) * grid.dx_m;
    const double y = grid.origin_y_m + static_cast<double>(n / grid.nx) * grid.dy_m;
    const auto [ux, uy] = motion(x, y);
    const bool seen = std::min({x, x + ux, y, y + uy}) > kBorderM && std::max(x, x + ux) < width - kBorderM &&
                      std::max(y, y + uy) < depth - kBorderM;
    if (!seen) continue;
    ++inside;
    const double quarter_m = speckle.geometry().sound_speed_m_s / speckle.geometry().center_frequency_hz / 8;
    const bool whole = std::min(x, x + ux) > 2 * kBorderM && std::max(x, x + ux) < width - 2 * kBorderM;
    if (whole && !(std::abs(field[2 * n + 1] - uy) < quarter_m)) ++errors.hop_fraction;
    if (!trusted[n]) continue;
    if (!(std::abs(field[2 * n + 1] - uy) < quarter_m)) ++errors.trusted_hops;
    errors.axial_m.push_back(field[2 * n + 1] - uy);
    errors.lateral_m.push_back(field[2 * n] - ux);
  }
  errors.hop_fraction /= inside;
  errors.trusted_fraction = static_cast<double>(errors.axial_m.size()) / inside;
  return errors;
}

Motion uniform_strain(double strain, double offset_m) {
  return [=](double, double y) { return std::pair{0.0, offset_m + strain * y}; };
}

// What a window of a known geometry asks of a device. On a processor one item solves a refinement step: its
// chain is as long as a launch may be that nobody can cancel.
TEST(Displacement, AsksLittleOfTheDevice) {
  constexpr std::uint64_t kChainOfGpu = 1024, kChainOfProcessor = std::uint64_t{1} << 19;
  DeviceOptions options;
  options.as_gpu = true;
  const Speckle speckle({});
  const RfFrame pre = speckle.frame(uniform_strain(0, 0), 1),
                post = speckle.frame(uniform_strain(-0.01, 0), 2);
  for (const auto& device : {imaging_device(), Device::open(options)}) {
    const Queue queue = device->queue();
    DisplacementEstimator estimator(queue, {});
    estimator.estimate(pre, post, speckle.geometry());
    queue.take_work();
    estimator.estimate(pre, post, speckle.geometry());
    const DeviceWork work = queue.take_work();
    EXPECT_LE(work.launches, 54u);
    EXPECT_LE(work.waits, 2u);
    EXPECT_LE(work.looks, 4u);
    EXPECT_LE(work.longest_chain, device->info().gpu ? kChainOfGpu : kChainOfProcessor);
  }
}

// And with its strain, downloaded.
TEST(Displacement, AFewWaitsAreAWholeWindows) {
  const Speckle speckle({});
  const RfFrame pre = speckle.frame(uniform_strain(0, 0), 1),
                post = speckle.frame(uniform_strain(-0.01, 0), 2);
  const Queue queue = imaging_device()->queue();
  DisplacementEstimator estimator(queue, {});
  StrainEstimator strain(queue, {});
  for (const bool known : {false, true}) {
    queue.take_work();
    const DisplacementEstimate estimate = estimator.estimate(pre, post, speckle.geometry());
    Measured measured;
    measured.grid = image_grid(estimate.grid, speckle.geometry());
    download(queue, estimate, measured);
    download(queue, strain.estimate(estimate, measured.grid), measured);
    const DeviceWork work = queue.take_work();
    if (!known) continue;
    EXPECT_LE(work.launches, 57u);
    EXPECT_LE(work.waits, 4u);
  }
}

TEST(Displacement, FindsRigidSubSampleShiftsWithoutBias) {
  const double sample = speckle_geometry().sample_pitch_m();
  for (const double shift : {0.0, 0.125, 0.5, 0.8, 3.3, -7.6}) {
    const Errors e = track(
        {},
        [=](double, double) {
          return std::pair{0.0, shift * sample};
        },
        {}, DisplacementFrame::kLab);
    EXPECT_GE(e.trusted_fraction, 0.99) << shift;
    EXPECT_LE(std::abs(e.bias_axial()), 0.05e-6) << shift;
    EXPECT_LE(e.quantile_axial(1), 0.3e-6) << shift;
  }
}

TEST(Displacement, FindsUniformStrainOfBothSigns) {
  SpeckleOptions speckle;
  speckle.samples = 1200;
  for (const double strain : {-0.005, -0.01, -0.03, -0.05, 0.02, 0.05}) {
    const Errors e = track(speckle, uniform_strain(strain, 0));
    EXPECT_GE(e.trusted_fraction, 0.97) << strain;
    EXPECT_LE(e.median_axial(), 0.7e-6) << strain;
    EXPECT_LE(e.quantile_axial(0.95), 3e-6) << strain;
  }
}

// LAB frame: the probe moves, the far side rests.
TEST(Displacement, FindsTheLabFrameAsWellAsTheProbeFrame) {
  SpeckleOptions speckle;
  speckle.samples = 1500;
  const double depth = 1500 * speckle_geometry().sample_pitch_m();
  const Errors e = track(speckle, uniform_strain(-0.03, 0.03 * depth), {}, DisplacementFrame::kLab);
  EXPECT_GE(e.trusted_fraction, 0.97);
  EXPECT_LE(e.quantile_axial(0.95), 2e-6);
}

TEST(Displacement, FindsLateralShiftOfSeveralLines) {
  const double pitch = speckle_geometry().line_pitch_m;
  for (const double lines : {-2.6, 0.4, 1.7, 3.0}) {
    const Errors e = track({}, [=](double, double y) { return std::pair{lines * pitch, -0.01 * y}; });
    EXPECT_GE(e.trusted_fraction, 0.95) << lines;
    EXPECT_LE(e.quantile_lateral(0.5), 8e-6) << lines;
    EXPECT_LE(e.quantile_axial(0.95), 3e-6) << lines;
  }
}

// 60 mm of nearly incompressible tissue, stuck to its base: it widens by up to 1.5 mm, and strains by more
// than the mean compression over the upper 20 mm. At its sides tissue leaves the frame: one node in a hundred
// may hop, and none that does may be trusted.
TEST(Displacement, FollowsTheLargestCompressionAndTrustsNoHop) {
  for (const auto& [snr_db, correlation] : {std::pair{30.0, 0.99}, {10.0, 0.9}}) {
    SpeckleOptions speckle;
    speckle.samples = 1500;
    speckle.lines = 256;
    speckle.scatterers_per_mm2 = 40;
    speckle.snr_db = snr_db;
    speckle.correlation = correlation;
    const Errors e = track(speckle, [](double x, double y) {
      return std::pair{0.05 * (x - 30e-3), -0.065 * std::min(y, 20e-3) - 0.03 * std::max(y - 20e-3, 0.0)};
    });
    EXPECT_LE(e.hop_fraction, 0.01) << snr_db;
    EXPECT_EQ(e.trusted_hops, 0) << snr_db;
    EXPECT_GE(e.trusted_fraction, correlation > 0.95 ? 0.95 : 0.85) << snr_db;
    EXPECT_LE(e.median_axial(), 2e-6) << snr_db;
  }
}

TEST(Displacement, HoldsUnderNoiseAndDecorrelation) {
  SpeckleOptions speckle;
  speckle.samples = 900;
  speckle.snr_db = 20;
  speckle.correlation = 0.95;
  const Errors e = track(speckle, uniform_strain(-0.0125, 0));
  EXPECT_GE(e.trusted_fraction, 0.95);
  EXPECT_LE(e.median_axial(), 2e-6);
  EXPECT_LE(e.quantile_axial(0.99), 12e-6);
}

TEST(Displacement, AwkwardSizesWork) {
  for (const auto& [samples, lines] : {std::pair<std::size_t, std::size_t>{211, 14}, {331, 19}, {997, 13}}) {
    SpeckleOptions speckle;
    speckle.samples = samples;
    speckle.lines = lines;
    const Errors e = track(speckle, uniform_strain(-0.01, 0));
    EXPECT_GE(e.trusted_fraction, 0.9) << samples << " x " << lines;
    EXPECT_LE(e.quantile_axial(0.95), 2e-6) << samples << " x " << lines;
  }
}

// Smaller than the windows: nothing lies inside the border, but every number must still be a small one.
TEST(Displacement, SmallestFramesGiveFiniteNumbers) {
  for (const auto& [samples, lines] : {std::pair<std::size_t, std::size_t>{64, 8}, {64, 33}, {211, 8}}) {
    SpeckleOptions options;
    options.samples = samples;
    options.lines = lines;
    const Speckle speckle(options);
    const RfFrame pre = speckle.frame([](double, double) { return std::pair{0.0, 0.0}; }, 1);
    const Queue queue = imaging_device()->queue();
    DisplacementEstimator estimator(queue, {});
    const DisplacementEstimate e = estimator.estimate(pre, pre, speckle.geometry());
    const std::vector<float> field = queue.read(e.field_m);
    ASSERT_GT(field.size(), 0u);
    for (const float u : field) EXPECT_LE(std::abs(u), 1e-4) << samples << " x " << lines;
  }
}

TEST(Displacement, SilentRegionsAreNotTrusted) {
  const Speckle speckle(SpeckleOptions{});
  RfFrame pre = speckle.frame([](double, double) { return std::pair{0.0, 0.0}; }, 1);
  RfFrame post = speckle.frame(uniform_strain(-0.01, 0), 2);
  for (std::size_t l = 0; l < pre.line_count; ++l)
    for (std::size_t k = 0; k < 200; ++k) pre.samples[k + 640 * l] = post.samples[k + 640 * l] = 0;
  const Queue queue = imaging_device()->queue();
  DisplacementEstimator estimator(queue, {});
  const DisplacementEstimate e = estimator.estimate(pre, post, speckle.geometry());
  const std::vector<std::uint8_t> trusted = queue.read(e.trusted);
  int wrong = 0, deep = 0;  // half of a kernel below the silence, and two rows of doubt
  for (int n = 0; n < e.grid.nodes(); ++n) {
    const int sample = e.grid.first_sample + n / e.grid.nx * e.grid.sample_step;
    wrong += sample < 265 && trusted[n];
    deep += sample > 310 && sample < 590 && !trusted[n];
  }
  EXPECT_EQ(wrong, 0);
  EXPECT_LE(deep, e.grid.nodes() / 50);
}

// Offset-binary samples, 2048 where nothing comes back: 143 um off and all trusted, once.
TEST(Displacement, AConstantUnderTheEchoesChangesNothing) {
  const Speckle speckle({.samples = 1000, .lines = 32});
  const AcquisitionGeometry geometry = speckle.geometry();
  RfFrame pre = speckle.frame(uniform_strain(0, 0), 1), post = speckle.frame(uniform_strain(-0.01, 0), 2);
  const Queue queue = imaging_device()->queue();
  DisplacementEstimator estimator(queue, {});
  const auto field = [&] { return queue.read(estimator.estimate(pre, post, geometry).field_m); };
  const std::vector<float> without = field();
  double largest = 0;
  for (const float s : pre.samples) largest = std::max<double>(largest, std::abs(s));
  for (float& s : pre.samples) s += static_cast<float>(5 * largest);
  for (float& s : post.samples) s += static_cast<float>(4.9 * largest);
  const std::vector<float> with = field();
  ASSERT_EQ(with.size(), without.size());
  for (std::size_t n = 1; n < with.size(); n += 2) EXPECT_NEAR(with[n], without[n], 0.05e-6) << n;
}

TEST(Displacement, RefusesAnUnusableLargestStrain) {
  const Queue queue = imaging_device()->queue();
  DisplacementOptions options;
  options.max_strain = std::nan("");
  EXPECT_THROW(DisplacementEstimator(queue, options), std::invalid_argument);
}

}  // namespace
}  // namespace teletact::service
