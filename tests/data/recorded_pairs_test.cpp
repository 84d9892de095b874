// Acceptance on RF data that nobody here made (../shared/data, see its README): the same thresholds in the
// code for both.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <tuple>
#include <vector>

#include "service/imaging/estimate.h"
#include "tests/data/plain_ncc.h"
#include "tests/data/recorded_pairs.h"

namespace teletact::service {
namespace {

Estimate estimate(const RecordedPair& pair, double depth_m, const StrainOptions& strain = {}) {
  ElastographyOptions options;
  options.strain = strain;
  Elastography elastography(Device::open(), options);
  const double width_m = static_cast<double>(pair.pre.line_count) * pair.geometry.line_pitch_m;
  return elastography.estimate(pair.pre, pair.post,
                               {pair.geometry, std::nullopt, {width_m, depth_m, 0, 0.495}});
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
  StrainOptions kernel;
  kernel.kernel_axial_m = 1.5e-3;
  const Estimate e = estimate(pair, 0.050, kernel);
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
  std::printf(
      "simulated-inclusion: valid %.3f, axial |error| median %.2f p95 %.2f max %.2f um, RMSE %.2f um; "
      "lateral "
      "RMSE %.1f um; axial strain RMSE (1.5 mm) %.3f %% strain\n",
      count / inside, 1e6 * median, 1e6 * p95, 1e6 * errors.back(), 1e6 * std::sqrt(axial / count),
      1e6 * std::sqrt(lateral / count), 100 * std::sqrt(strain_squares / strain_count));
  EXPECT_GE(count / inside, 0.95);
  // The image grid leaves nothing of that interior out.
  EXPECT_GE(inside * e.grid.dx_m * e.grid.dy_m, 0.97 * displacement.area_m2());
  EXPECT_LE(std::sqrt(axial / count), 2.5e-6);
  EXPECT_LE(p95, 5e-6);
  EXPECT_LE(errors.back(), 20e-6);
  EXPECT_LE(std::sqrt(lateral / count), 22e-6);
  EXPECT_GE(strain_count / inside, 0.95);
  EXPECT_LE(std::sqrt(strain_squares / strain_count), 0.2e-2);
}

// Axial strain of a method on an image grid; NaN where it says nothing.
struct StrainImage {
  ImageGrid grid;
  std::vector<double> strain;
};

StrainImage strain_image(const Queue& queue, const DisplacementEstimate& d, const ImageGrid& grid,
                         double kernel_axial_m, double kernel_lateral_m) {
  StrainOptions options;
  options.kernel_axial_m = kernel_axial_m;
  options.kernel_lateral_m = kernel_lateral_m;
  options.residual_limit_m = 1;  // the same chance for every method: nothing is hidden
  const StrainEstimate s = StrainEstimator(queue, options).estimate(d, grid);
  const std::vector<float> tensor = queue.read(s.tensor);
  StrainImage image{grid, {}};
  for (std::size_t n = 0; n < grid.size(); ++n) image.strain.push_back(tensor[4 * n + 1]);
  return image;
}

// Median over the inner 70 % of the inclusion's radius (4 mm, at 25.12 mm of depth and 39.91 mm of the
// truth's lateral axis, where the true strain is least) over the median further than 2 mm outside.
double inclusion_contrast(const Estimate& e, double first_line_m, double pitch_m) {
  std::vector<double> inside, outside;
  for (std::size_t n = 0; n < e.grid.size(); ++n) {
    if (!e.valid[n]) continue;
    const double x = x_of(e, n) - 0.5 * pitch_m + first_line_m;
    const double radius_m = std::hypot(x - 0.03991, y_of(e, n) - 0.02512);
    if (radius_m < 0.7 * 0.004) inside.push_back(e.modulus.youngs_modulus[n]);
    if (radius_m > 0.006) outside.push_back(e.modulus.youngs_modulus[n]);
  }
  const auto median = [](std::vector<double>& values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
  };
  if (inside.empty() || outside.empty()) return std::nan("");
  return median(inside) / median(outside);
}

// Modulus in plane stress against the truth: 8 mm at the image's middle, 4 times the background (1 / strain
// gives 2.9). The contrast as T3.3 defines it.
TEST(SimulatedInclusion, ModulusKeepsItsContrast) {
  SKIP_WITHOUT_DATA("simulated-inclusion");
  const RecordedPair pair = simulated_inclusion();
  const double width_m = static_cast<double>(pair.pre.line_count) * pair.geometry.line_pitch_m;
  const double first_line_m =
      client::read_metaimage(data_folder() / "simulated-inclusion" / "pre.mha").origin.at(1);
  Elastography elastography(Device::open());
  for (const auto& [kind, least, most] :
       {std::tuple{ModulusKind::kDirect, 3.2, 4.8}, {ModulusKind::kIterative, 3.5, 4.4}}) {
    const Estimate e = elastography.estimate(
        pair.pre, pair.post,
        {pair.geometry, std::nullopt, {width_m, 0.050, 0, 0.495, Plane::kStress}, {}, {kind, 60.0}});
    const double contrast = inclusion_contrast(e, first_line_m, pair.geometry.line_pitch_m);
    std::printf("simulated-inclusion: contrast %.2f of 4, %d steps, converged %d\n", contrast,
                e.modulus.iterations, e.modulus.converged);
    for (const Warning& w : e.modulus.warnings) std::printf("  %s\n", w.text.c_str());
    EXPECT_GE(contrast, least);
    EXPECT_LE(contrast, most);
    EXPECT_FALSE(e.modulus.absolute);
  }
}

// Both were pressed by plates wider than the tissue: nobody states it, the strain tells.
TEST(SimulatedInclusion, IsTakenForABlock) {
  SKIP_WITHOUT_DATA("simulated-inclusion");
  const RecordedPair pair = simulated_inclusion();
  const double width_m = static_cast<double>(pair.pre.line_count) * pair.geometry.line_pitch_m;
  const double first_line_m =
      client::read_metaimage(data_folder() / "simulated-inclusion" / "pre.mha").origin.at(1);
  TissueExtent extent{width_m, 0.050, 0, 0.495, Plane::kSolid};
  extent.depth_stated = false;
  const Estimate e =
      Elastography(Device::open())
          .estimate(pair.pre, pair.post, {pair.geometry, std::nullopt, extent, {}, {{}, 60.0}});
  const double contrast = inclusion_contrast(e, first_line_m, pair.geometry.line_pitch_m);
  std::printf("simulated-inclusion: contrast %.2f of 4; %s\n", contrast, e.modulus.model.c_str());
  EXPECT_NE(e.modulus.model.find("that is a block"), std::string::npos) << e.modulus.model;
  EXPECT_GE(contrast, 3.2);
  EXPECT_LE(contrast, 4.8);
}

struct WindowStatistics {
  double mean = 0, variance = 0, valid = 0;
};

// Over samples x lines of the README.
WindowStatistics window(const StrainImage& e, const AcquisitionGeometry& g, double s0, double s1, double l0,
                        double l1) {
  double sum = 0, squares = 0, count = 0, all = 0;
  for (std::size_t n = 0; n < e.grid.size(); ++n) {
    const double y = e.grid.origin_y_m + static_cast<double>(n / e.grid.nx) * e.grid.dy_m;
    const double x = e.grid.origin_x_m + static_cast<double>(n % e.grid.nx) * e.grid.dx_m;
    const double sample = y / g.sample_pitch_m(), line = x / g.line_pitch_m - 0.5;
    if (sample < s0 || sample > s1 || line < l0 || line > l1) continue;
    ++all;
    if (!std::isfinite(e.strain[n])) continue;
    ++count;
    sum += e.strain[n];
    squares += e.strain[n] * e.strain[n];
  }
  const double mean = sum / count;
  return {mean, squares / count - mean * mean, count / all};
}

struct PhantomFigures {
  double background = 0, inclusion = 0, snre = 0, cnre = 0, edge_m = 0, valid = 0;
};

// Lateral distance (m) from the inclusion's middle outwards (direction -1 or 1) between 20 % and 80 % of the
// way from its strain to the background's on that side, in the mean profile over the README's depth window.
double edge_width(const StrainImage& e, const AcquisitionGeometry& g, int direction, double inclusion,
                  double background) {
  const auto profile = [&](double line) {
    return window(e, g, 1790, 1900, line - 0.5 * e.grid.dx_m / g.line_pitch_m,
                  line + 0.499 * e.grid.dx_m / g.line_pitch_m)
        .mean;
  };
  const double step = direction * e.grid.dx_m / g.line_pitch_m;
  double found[2] = {std::nan(""), std::nan("")};
  for (int level = 0; level < 2; ++level) {
    const double wanted = level ? 0.8 : 0.2;
    for (double line = 160; line > 90 && line < 230 && std::isnan(found[level]); line += step) {
      const double here = (profile(line) - inclusion) / (background - inclusion);
      const double next = (profile(line + step) - inclusion) / (background - inclusion);
      if (here <= wanted && next > wanted) found[level] = line + step * (wanted - here) / (next - here);
    }
  }
  return std::abs(found[1] - found[0]) * g.line_pitch_m;
}

PhantomFigures figures(const StrainImage& e, const AcquisitionGeometry& g) {
  const WindowStatistics target = window(e, g, 1790, 1900, 145, 175), left = window(e, g, 1790, 1900, 30, 90),
                         right = window(e, g, 1790, 1900, 230, 290),
                         uniform = window(e, g, 900, 1300, 60, 250);
  const double background = 0.5 * (left.mean + right.mean), variance = 0.5 * (left.variance + right.variance);
  return {background,
          target.mean,
          std::abs(uniform.mean) / std::sqrt(uniform.variance),
          std::sqrt(2 * std::pow(background - target.mean, 2) / (variance + target.variance)),
          0.5 * (edge_width(e, g, -1, target.mean, left.mean) + edge_width(e, g, 1, target.mean, right.mean)),
          window(e, g, 300, 1e9, -1, 1e9).valid};
}

void print(const char* method, const PhantomFigures& f) {
  std::printf(
      "phantom-s2000, %s: background %.3f %%, inclusion %.3f %%, SNRe %.1f, CNRe (Rivaz) %.2f, edge %.2f "
      "mm\n",
      method, 100 * f.background, 100 * f.inclusion, f.snre, f.cnre, 1e3 * f.edge_m);
}

// Figures between two kernels at an edge width between theirs, linear in it.
PhantomFigures at_edge(const PhantomFigures& a, const PhantomFigures& b, double edge_m) {
  const double t = (edge_m - a.edge_m) / (b.edge_m - a.edge_m);
  PhantomFigures out = a;
  out.snre += t * (b.snre - a.snre);
  out.cnre += t * (b.cnre - a.cnre);
  out.edge_m = edge_m;
  return out;
}

// SNRe and CNRe at least twice plain NCC's at the same edge width, at most 2 mm: NCC's kernel across the
// lines grows until its edge is as wide as ours; its figures are taken between the two kernels on both sides.
TEST(PhantomS2000, TwiceAsClearAsPlainNccAtTheSameEdge) {
  SKIP_WITHOUT_DATA("phantom-s2000");
  const RecordedPair pair = phantom_s2000();
  const Queue queue = Device::open()->queue();
  DisplacementEstimator estimator(queue, {});
  const DisplacementEstimate ours = estimator.estimate(pair.pre, pair.post, pair.geometry);
  const ImageGrid grid = image_grid(ours.grid, pair.geometry);
  const PhantomFigures best = figures(strain_image(queue, ours, grid, 2.5e-3, 2.0e-3), pair.geometry);
  print("ours", best);

  DisplacementEstimate ncc{ours.grid, {}, {}, {}};
  const std::vector<float> field = median_filtered(plain_ncc(pair, ours.grid), ours.grid);
  std::vector<std::uint8_t> known;
  std::vector<float> finite;
  for (std::size_t n = 0; n < grid.size(); ++n) known.push_back(std::isnan(field[2 * n]) ? 0 : 1);
  for (const float u : field) finite.push_back(std::isnan(u) ? 0 : u);
  ncc.field_m = queue.array(finite);
  ncc.trusted = queue.array(known);
  PhantomFigures sharper, plain;
  for (double lateral_m = 1.0e-3; lateral_m < 6e-3 && !(plain.edge_m > best.edge_m); lateral_m += 0.5e-3) {
    sharper = plain;
    plain = figures(strain_image(queue, ncc, grid, 2.5e-3, lateral_m), pair.geometry);
    print("plain NCC", plain);
  }
  ASSERT_GT(sharper.edge_m, 0);
  ASSERT_GT(plain.edge_m, best.edge_m);
  plain = at_edge(sharper, plain, best.edge_m);
  print("plain NCC between them", plain);
  EXPECT_LE(best.edge_m, 2e-3);
  EXPECT_GE(best.snre, 2 * plain.snre);
  EXPECT_GE(best.cnre, 2 * plain.cnre);
  EXPECT_GE(best.background / best.inclusion, 1.35);
  EXPECT_LE(best.background / best.inclusion, 1.70);
}

TEST(PhantomS2000, NearlyAllOfTheTissueIsValid) {
  SKIP_WITHOUT_DATA("phantom-s2000");
  const RecordedPair pair = phantom_s2000();
  const Estimate e = estimate(pair, 0.060);
  double tissue = 0, valid = 0;
  for (std::size_t n = 0; n < e.grid.size(); ++n) {
    if (y_of(e, n) < 300 * pair.geometry.sample_pitch_m()) continue;
    ++tissue, valid += e.strain_valid[n];
  }
  EXPECT_GE(valid / tissue, 0.95);
  EXPECT_GE(e.quality, 0.9);
}

// The last tenth of both frames holds nothing: as if it were cut off.
TEST(PhantomS2000, ASilentTailIsAsIfItWereCutOff) {
  SKIP_WITHOUT_DATA("phantom-s2000");
  RecordedPair silent = phantom_s2000(), cut = silent;
  const std::size_t all = silent.pre.sample_count, heard = all - all / 10;
  for (const auto& [whole, trimmed] :
       {std::pair{&silent.pre, &cut.pre}, std::pair{&silent.post, &cut.post}}) {
    trimmed->sample_count = heard, trimmed->samples.clear();
    for (std::size_t l = 0; l < whole->line_count; ++l) {
      const auto line = whole->samples.begin() + static_cast<std::ptrdiff_t>(l * all), end = line + heard;
      trimmed->samples.insert(trimmed->samples.end(), line, end);
      std::fill(end, line + all, 0.0f);
    }
  }
  const Estimate a = estimate(silent, 0.060), b = estimate(cut, 0.060);
  const double heard_m = static_cast<double>(heard) * silent.geometry.sample_pitch_m();
  double compared = 0;
  for (std::size_t n = 0; n < a.grid.size(); ++n) {
    if (!a.strain_valid[n]) continue;
    EXPECT_LT(y_of(a, n), heard_m - 1e-3);
    const double row = (y_of(a, n) - b.grid.origin_y_m) / b.grid.dy_m;
    const std::size_t above = static_cast<std::size_t>(row) * b.grid.nx + n % a.grid.nx,
                      below = above + b.grid.nx;
    if (y_of(a, n) < heard_m - 5e-3 || !b.strain_valid[above] || !b.strain_valid[below]) continue;
    const double share = row - std::floor(row);
    EXPECT_NEAR(a.axial_strain[n], (1 - share) * b.axial_strain[above] + share * b.axial_strain[below], 2e-3);
    ++compared;
  }
  EXPECT_GE(compared, 400);
}

}  // namespace
}  // namespace teletact::service
