// GLUE, Hashemi & Rivaz 2017, "Global time-delay estimation in ultrasound elastography", IEEE TUFFC
// 64(10):1625-1636, doi 10.1109/TUFFC.2017.2717933: around the whole-sample displacement of dynamic
// programming, one linear system for the sub-sample displacement of all samples, both directions, with
// first-order regularisation from sample to sample (alpha_1, beta_1) and from line to line (alpha_2, beta_2).
// Theirs is one linearisation and a direct solve; this one linearises again on the interpolated image, and
// solves by conjugate gradients with line Gauss-Seidel (the same minimum).
#include <algorithm>
#include <cmath>

#include "bench/peers/line_path.h"
#include "bench/peers/line_system.h"
#include "bench/peers/rf_nodes.h"
#include "service/imaging/tracking/interpolation.h"

namespace teletact::bench {
namespace {

using reference::RfImage;

constexpr int kPasses = 2;
constexpr double kStepCost = 0.2;
// Images scaled to a largest value of 1, as there. The weights are the best of ten combinations on the
// chart's middle phantom: the usual 5 and 1 between lines cost twice the RMSE and half the SNRe at the same
// edge width.
constexpr RegularisationWeights kWeights{.axial_1 = 5, .axial_2 = 0.2, .lateral_1 = 5, .lateral_2 = 0.2};

RfImage scaled(RfImage image, double factor) {
  for (double& v : image.values) v *= factor;
  return image;
}

// post and its gradient at x + u(x).
struct Warped {
  std::vector<double> value, axial_slope, lateral_slope;
};

// Windowed sinc axially, Keys' cubic laterally: the product's own interpolation.
class Interpolator {
 public:
  explicit Interpolator(const RfImage& image) : image_(image), taps_(service::interpolation_taps()) {}
  double at(double sample, double line) const {
    const int k0 = static_cast<int>(std::floor(sample)), l0 = static_cast<int>(std::floor(line));
    const auto phase = std::lround((sample - k0) * service::kInterpolationPhases);
    const float* taps = &taps_[static_cast<std::size_t>(phase * service::kInterpolationTaps)];
    const double f = line - l0;
    const double across[] = {((-.5 * f + 1) * f - .5) * f, (1.5 * f - 2.5) * f * f + 1,
                             ((-1.5 * f + 2) * f + .5) * f, (.5 * f - .5) * f * f};
    double sum = 0;
    for (int l = 0; l < 4; ++l) {
      if (across[l] == 0) continue;
      double along = 0;
      for (int t = 0; t < service::kInterpolationTaps; ++t)
        along += taps[t] * image_.at(k0 - 3 + t, l0 - 1 + l);
      sum += across[l] * along;
    }
    return sum;
  }

 private:
  const RfImage& image_;
  std::vector<float> taps_;
};

Warped warp(const RfImage& post, const std::vector<double>& axial, const std::vector<double>& lateral) {
  const Interpolator interpolator(post);
  RfImage moved{post.samples, post.lines, std::vector<double>(post.values.size())};
  for (int l = 0; l < post.lines; ++l)
    for (int k = 0; k < post.samples; ++k) {
      const auto n = static_cast<std::size_t>(k + post.samples * l);
      moved.values[n] = interpolator.at(k + axial[n], l + lateral[n]);
    }
  Warped w;
  for (int l = 0; l < post.lines; ++l)
    for (int k = 0; k < post.samples; ++k) {
      w.axial_slope.push_back(
          (8 * (moved.at(k + 1, l) - moved.at(k - 1, l)) - (moved.at(k + 2, l) - moved.at(k - 2, l))) / 12);
      w.lateral_slope.push_back((moved.at(k, l + 1) - moved.at(k, l - 1)) / 2);
    }
  w.value = std::move(moved.values);
  return w;
}

void refine(const RfImage& pre, const Warped& post, std::vector<double>& axial,
            std::vector<double>& lateral) {
  LineSystem system(pre.samples, pre.lines, kWeights);
  for (std::size_t n = 0; n < pre.values.size(); ++n)
    system.add_datum(n, post.axial_slope[n], post.lateral_slope[n], pre.values[n] - post.value[n]);
  system.add_smoothness_of(axial, lateral);
  const std::vector<double> step = system.solve();
  for (std::size_t n = 0; n < axial.size(); ++n) axial[n] += step[2 * n], lateral[n] += step[2 * n + 1];
}

Track result(const TrackerOptions& options, const RfImage& pre, const Warped& post,
             const std::vector<double>& axial, const std::vector<double>& lateral, const Nodes& nodes) {
  const RfImage moved{pre.samples, pre.lines, post.value};
  const reference::Window window = nodes.window(options.window_axial_m, options.window_lateral_m);
  LagField field(nodes.image.size());
  for (int j = 0; j < nodes.grid.ny; ++j)
    for (int i = 0; i < nodes.grid.nx; ++i) {
      const auto n = static_cast<std::size_t>(nodes.sample(j) + pre.samples * nodes.line(i));
      field.axial[nodes.at(i, j)] = axial[n];
      field.lateral[nodes.at(i, j)] = lateral[n];
      field.correlation[nodes.at(i, j)] =
          reference::normalised_cross_correlation(pre, moved, nodes.sample(j), nodes.line(i), window, 0, 0);
    }
  return track_of(nodes, field, options.min_correlation);
}

Track by_global_regularisation(const TrackerOptions& options, const service::RfFrame& pre_frame,
                               const service::RfFrame& post_frame,
                               const service::AcquisitionGeometry& geometry) {
  const Nodes nodes(pre_frame, geometry, options.grid_dx_m, options.grid_dy_m);
  RfImage pre = image_of(pre_frame), post = image_of(post_frame);
  double largest = 1e-30;
  for (const double v : pre.values) largest = std::max(largest, std::abs(v));
  pre = scaled(std::move(pre), 1 / largest);
  post = scaled(std::move(post), 1 / largest);
  PathOptions path;
  path.first_sample = geometry.first_sample_depth_m / nodes.sample_m;
  path.max_strain = options.max_strain;
  path.axial_reach = static_cast<int>(std::ceil(options.max_strain * (path.first_sample + pre.samples))) + 4;
  path.lateral_reach = static_cast<int>(std::ceil(options.lateral_search_m / nodes.line_m));
  path.step_cost = kStepCost;
  const Paths paths = find_line_paths(pre, post, path);
  std::vector<double> axial(paths.axial.begin(), paths.axial.end()),
      lateral(paths.lateral.begin(), paths.lateral.end());
  for (int pass = 0; pass < kPasses; ++pass) refine(pre, warp(post, axial, lateral), axial, lateral);
  return result(options, pre, warp(post, axial, lateral), axial, lateral, nodes);
}

}  // namespace

Tracker make_glue_tracker(TrackerOptions options) {
  return {"DP and global regularisation (GLUE)", std::bind_front(by_global_regularisation, options)};
}

}  // namespace teletact::bench
