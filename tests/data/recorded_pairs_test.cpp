// Acceptance on RF data that nobody here made (../shared/data, see its README): the same thresholds in the
// code for both.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>

#include "service/imaging/estimate.h"
#include "tests/data/recorded_pairs.h"

namespace teletact::service {
namespace {

#define SKIP_WITHOUT_DATA(name)                                                                 \
  if (!std::filesystem::exists(data_folder() / name)) {                                         \
    std::printf("SKIPPED: no %s\n", (data_folder() / name).c_str());                            \
    GTEST_SKIP() << "no " << (data_folder() / name) << ": these data may not be redistributed"; \
  }

Estimate estimate(const RecordedPair& pair, double depth_m) {
  Elastography elastography(Device::open());
  const double width_m = static_cast<double>(pair.pre.line_count) * pair.geometry.line_pitch_m;
  return elastography.estimate(pair.pre, pair.post, pair.geometry, std::nullopt,
                               {width_m, depth_m, 0, 0.495});
}

double x_of(const Estimate& e, std::size_t n) {
  return e.grid.origin_x_m + static_cast<double>(n % e.grid.nx) * e.grid.dx_m;
}
double y_of(const Estimate& e, std::size_t n) {
  return e.grid.origin_y_m + static_cast<double>(n / e.grid.nx) * e.grid.dy_m;
}

// Bilinear values of one channel of an image whose first axis is depth; nothing within `margin_m` of its
// edges.
class Truth {
 public:
  Truth(const std::filesystem::path& path, double margin_m)
      : image_(client::read_metaimage(path)), values_(image_.as<double>()), margin_m_(margin_m) {}
  std::optional<double> at(double y_m, double x_m, std::size_t channel) const {
    const double r = (y_m - image_.origin[0]) / image_.spacing[0],
                 c = (x_m - image_.origin[1]) / image_.spacing[1];
    const double rows = margin_m_ / image_.spacing[0], columns = margin_m_ / image_.spacing[1];
    if (r < rows || c < columns || r > image_.size[0] - 1 - rows || c > image_.size[1] - 1 - columns)
      return {};
    const auto j = static_cast<std::size_t>(r), i = static_cast<std::size_t>(c);
    const double s = r - static_cast<double>(j), t = c - static_cast<double>(i);
    const auto v = [&](std::size_t a, std::size_t b) {
      return values_[image_.channels * (a + image_.size[0] * b) + channel];
    };
    return (1 - s) * ((1 - t) * v(j, i) + t * v(j, i + 1)) +
           s * ((1 - t) * v(j + 1, i) + t * v(j + 1, i + 1));
  }
  double area_m2() const {
    const auto side = [&](std::size_t axis) {
      return static_cast<double>(image_.size[axis] - 1) * image_.spacing[axis] - 2 * margin_m_;
    };
    return side(0) * side(1);
  }

 private:
  client::MetaImage image_;
  std::vector<double> values_;
  double margin_m_;
};

TEST(SimulatedInclusion, AxialDisplacementMeetsTheTruth) {
  SKIP_WITHOUT_DATA("simulated-inclusion");
  const RecordedPair pair = simulated_inclusion();
  const Estimate e = estimate(pair, 0.050);
  const auto folder = data_folder() / "simulated-inclusion";
  const Truth displacement(folder / "truth_displacement.mha", 2e-3),
      strain(folder / "truth_strain.mha", 2e-3);
  const double first_line_m = client::read_metaimage(folder / "pre.mha").origin.at(1);
  std::vector<double> errors;
  double inside = 0, axial = 0, lateral = 0, strain_squares = 0, strain_count = 0;
  for (std::size_t n = 0; n < e.grid.size(); ++n) {
    const double x = x_of(e, n) - 0.5 * pair.geometry.line_pitch_m + first_line_m;
    const auto uy = displacement.at(y_of(e, n), x, 0), ux = displacement.at(y_of(e, n), x, 1);
    if (!uy) continue;
    ++inside;
    if (e.strain_valid[n])
      ++strain_count, strain_squares += std::pow(e.axial_strain[n] - *strain.at(y_of(e, n), x, 0), 2);
    if (!e.displacement_valid[n]) continue;
    ASSERT_TRUE(std::isfinite(e.axial_displacement[n]) && std::isfinite(e.lateral_displacement[n])) << n;
    errors.push_back(std::abs(e.axial_displacement[n] - *uy));
    axial += std::pow(e.axial_displacement[n] - *uy, 2);
    lateral += std::pow(e.lateral_displacement[n] - *ux, 2);
  }
  std::sort(errors.begin(), errors.end());
  const double count = static_cast<double>(errors.size());
  ASSERT_GT(count, 1000);
  const double median = errors[errors.size() / 2], p95 = errors[errors.size() * 95 / 100];
  const double wrong =
      static_cast<double>(errors.end() - std::upper_bound(errors.begin(), errors.end(), 40e-6));
  std::printf(
      "simulated-inclusion: valid %.3f, axial |error| median %.2f p95 %.2f max %.2f um, RMSE %.2f um; wrong "
      "by > 40 um "
      "%.4f; lateral RMSE %.1f um; axial strain RMSE %.3f %% strain\n",
      count / inside, 1e6 * median, 1e6 * p95, 1e6 * errors.back(), 1e6 * std::sqrt(axial / count),
      wrong / count, 1e6 * std::sqrt(lateral / count), 100 * std::sqrt(strain_squares / strain_count));
  EXPECT_GE(count / inside, 0.90);
  // The image grid leaves nothing of that interior out.
  EXPECT_GE(inside * e.grid.dx_m * e.grid.dy_m, 0.97 * displacement.area_m2());
  EXPECT_LE(median, 2e-6);
  EXPECT_LE(p95, 30e-6);
  EXPECT_LE(wrong / count, 0.01);
}

struct WindowStatistics {
  double mean = 0, variance = 0, valid = 0;
};

// Axial strain over samples x lines of the README.
WindowStatistics window(const Estimate& e, const AcquisitionGeometry& g, double s0, double s1, double l0,
                        double l1) {
  double sum = 0, squares = 0, count = 0, all = 0;
  for (std::size_t n = 0; n < e.grid.size(); ++n) {
    const double sample = y_of(e, n) / g.sample_pitch_m(), line = x_of(e, n) / g.line_pitch_m - 0.5;
    if (sample < s0 || sample > s1 || line < l0 || line > l1) continue;
    ++all;
    if (!e.strain_valid[n]) continue;
    ++count;
    sum += e.axial_strain[n];
    squares += std::pow(e.axial_strain[n], 2);
  }
  const double mean = sum / count;
  return {mean, squares / count - mean * mean, count / all};
}

TEST(PhantomS2000, StrainRatioAndCoverage) {
  SKIP_WITHOUT_DATA("phantom-s2000");
  const RecordedPair pair = phantom_s2000();
  const Estimate e = estimate(pair, 0.060);
  const WindowStatistics target = window(e, pair.geometry, 1790, 1900, 145, 175);
  const WindowStatistics left = window(e, pair.geometry, 1790, 1900, 30, 90);
  const WindowStatistics right = window(e, pair.geometry, 1790, 1900, 230, 290);
  const WindowStatistics uniform = window(e, pair.geometry, 900, 1300, 60, 250);
  const WindowStatistics tissue = window(e, pair.geometry, 300, 1e9, -1, 1e9);
  const double background = 0.5 * (left.mean + right.mean), variance = 0.5 * (left.variance + right.variance);
  const double ratio = background / target.mean;
  const double cnre = std::sqrt(2 * std::pow(background - target.mean, 2) / (variance + target.variance));
  std::printf(
      "phantom-s2000: background %.3f %% : inclusion %.3f %% = %.3f; valid %.3f of the tissue; SNRe %.1f, "
      "CNRe (Rivaz) %.2f\n",
      100 * background, 100 * target.mean, ratio, tissue.valid,
      std::abs(uniform.mean) / std::sqrt(uniform.variance), cnre);
  EXPECT_GE(ratio, 1.35);
  EXPECT_LE(ratio, 1.70);
  EXPECT_GE(tissue.valid, 0.85);
}

}  // namespace
}  // namespace teletact::service
