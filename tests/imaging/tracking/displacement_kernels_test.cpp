// Every kernel of search.cl and displacement.cl against the reference, on awkward sizes.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "service/imaging/tracking/interpolation.h"
#include "service/imaging/tracking/sample_grid.h"
#include "service/imaging/tracking/search.h"
#include "tests/imaging/imaging_device.h"
#include "tests/imaging/speckle.h"
#include "tests/reference/ncc.h"

namespace teletact::service {
namespace {

constexpr Range kNoRange{};

Range over(int items) {
  Range range = kNoRange;
  range.global[0] = static_cast<std::size_t>(items);
  range.local[0] = 32;
  return range;
}

reference::RfImage as_reference(const RfFrame& frame) {
  return {static_cast<int>(frame.sample_count),
          static_cast<int>(frame.line_count),
          {frame.samples.begin(), frame.samples.end()}};
}

// A pair with shift and strain on 203 x 17 samples, and its buffers.
class DisplacementKernels : public ::testing::Test {
 protected:
  DisplacementKernels() : queue_(imaging_device()->queue()) {
    SpeckleOptions options;
    options.samples = 203;
    options.lines = 17;
    const Speckle speckle(options);
    pre_ = speckle.frame([](double, double) { return std::pair{0.0, 0.0}; }, 1);
    post_ = speckle.frame([](double x, double y) { return std::pair{0.01 * x + 2e-5, -0.02 * y + 1e-5}; }, 2);
    pad_ = padding(pre_, 64, 12);
    pre_device_ = queue_.array(padded(pre_, pad_));
    post_device_ = queue_.array(padded(post_, pad_));
  }
  void expect_correlation(int line_stride) {
    const SampleGrid grid = centred_grid(pre_, 5, 37);
    const int half_axial = 13, half_lateral = 2, stride = 2, first_lag = -16, chunks = 4, lateral_count = 5,
              lateral_step = 2, margin = half_axial + 8, samples = 203 + 2 * margin;
    const auto items = static_cast<std::size_t>(grid.nodes() * lateral_count * chunks);
    Array<float> volume = queue_.array<float>(items * 8), pre_energy = queue_.array<float>(pad_.total),
                 post_energy = queue_.array<float>(pad_.total);
    for (Array<float>* array : {&volume, &pre_energy, &post_energy}) queue_.fill_zero(*array);
    const SampleBlocks of_pre{grid.first_sample, grid.sample_step, grid.ny},
        of_post{-margin, 8, (samples + 7) / 8};
    search("window_energy")(
        {{static_cast<std::size_t>(std::max(of_pre.count, of_post.count)), 17, 2}, {16, 1, 1}}, pre_device_,
        post_device_, pre_energy, post_energy, of_pre, of_post, half_axial, stride, pad_.layout);
    search("ncc")(over(static_cast<int>(items)), pre_device_, post_device_, pre_energy, post_energy, volume,
                  grid, pad_.layout, SearchWindow{half_axial, half_lateral, stride, line_stride},
                  SearchLags{first_lag, chunks, -2 * lateral_step, lateral_step, lateral_count, 7.5f, 0.02f,
                             0.0f, 0.25f});
    const std::vector<float> got = queue_.read(volume);
    const auto pre = as_reference(pre_), post = as_reference(post_);
    std::size_t n = 0;
    double worst = 0, largest = 0;
    for (int node = 0; node < grid.nodes(); ++node)
      for (int m = -2; m <= 2; ++m)
        for (int lag = first_lag; lag < first_lag + 8 * chunks; ++lag, ++n) {
          const int chunk_lag = first_lag + (lag - first_lag) / 8 * 8,
                    at = grid.first_sample + node / grid.nx * grid.sample_step;
          const double reach = 7.5 + 0.02 * at,
                       from_middle = grid.line_step * std::abs(node % grid.nx - (grid.nx - 1) / 2.0);
          const bool sideways = lateral_step * std::abs(m) < 0.25 * from_middle + lateral_step;
          if (chunk_lag > reach || chunk_lag + 7 < -reach || !sideways) {
            EXPECT_EQ(got[n], 0);
            continue;
          }
          const double want = reference::normalised_cross_correlation(
              pre, post, grid.first_sample + node / grid.nx * grid.sample_step,
              grid.first_line + node % grid.nx * grid.line_step,
              {half_axial, half_lateral, stride, line_stride}, lag, m * lateral_step);
          ASSERT_TRUE(std::isfinite(got[n]));
          worst = std::max(worst, std::abs(got[n] - want));
          largest = std::max(largest, want);
        }
    EXPECT_LE(worst, 2e-5) << line_stride;
    EXPECT_GE(largest, 0.8);  // the comparison saw true matches
  }
  Kernel kernel(const char* name) { return queue_.kernel("displacement", name, Precision::kFloat); }
  Kernel search(const char* name) { return queue_.kernel("search", name, Precision::kFloat); }

  Queue queue_;
  RfFrame pre_, post_;
  Padding pad_;
  Array<float> pre_device_, post_device_;
};

TEST_F(DisplacementKernels, CorrelationMatchesReference) {
  for (const int line_stride : {1, 2, 3}) expect_correlation(line_stride);
}

TEST_F(DisplacementKernels, BestLateralLagAndThoseAtOneAxialLag) {
  const int nodes = 7, chunks = 2, laterals = 3;
  std::vector<float> volume;
  for (int n = 0; n < nodes * laterals * chunks * 8; ++n)
    volume.push_back(std::sin(1.7f * static_cast<float>(n)));
  std::vector<int> lags;
  for (int node = 0; node < nodes; ++node) lags.push_back(5 * node % 16);
  const Array<float> v = queue_.array(volume), best = queue_.array<float>(nodes * chunks * 8),
                     at = queue_.array<float>(nodes * laterals);
  const SampleGrid g{nodes, 1, 0, 1, 10, 1};
  std::vector<EchoSpan> lines(nodes, {0, 20});
  constexpr int kSilent = 3, kEnds = 5;  // before and behind what these lines hold
  lines[kSilent].first = 11, lines[kEnds].end = 10;
  const Array<EchoSpan> spans = queue_.array(lines);
  search("best_lateral")(over(nodes * chunks), v, spans, best, g, chunks, laterals);
  search("laterals_at")(over(nodes * laterals), v, spans, queue_.array(lags), at, g, chunks, laterals);
  const std::vector<float> got = queue_.read(best), row = queue_.read(at);
  for (int node = 0; node < nodes; ++node)
    for (int lag = 0; lag < 16; ++lag) {
      float want = -1;
      for (int m = 0; m < laterals; ++m) {
        const float c = node == kSilent || node == kEnds
                            ? 0
                            : volume[static_cast<std::size_t>((node * laterals + m) * 16 + lag)];
        want = std::max(want, c);
        if (lag == lags[static_cast<std::size_t>(node)]) {
          EXPECT_EQ(row[static_cast<std::size_t>(node * laterals + m)], c) << node;
        }
      }
      EXPECT_EQ(got[static_cast<std::size_t>(node * 16 + lag)], want) << node;
    }
}

TEST_F(DisplacementKernels, WarpMatchesReference) {
  const SampleGrid grid = centred_grid(pre_, 4, 50);
  std::vector<float> field;
  for (int node = 0; node < grid.nodes(); ++node) {
    field.push_back(0.3f * static_cast<float>(node % grid.nx) - 0.7f);
    field.push_back(2.4f - 1.1f * static_cast<float>(node / grid.nx));
  }
  const Array<float> u = queue_.array(field), taps = queue_.array(interpolation_taps()),
                     series = queue_.array(interpolation_series());
  Array<float> mean = queue_.array<float>(pad_.total), difference = queue_.array<float>(pad_.total);
  const int lines = static_cast<int>(pre_.line_count), samples = static_cast<int>(pre_.sample_count),
            pair = 1;
  Range range = kNoRange;
  range.global = {(pre_.sample_count + 15) / 16, pre_.line_count, 1};
  range.local = {16, 1, 1};
  const EchoSpan before{30, samples - 40}, after{25, samples - 60};
  const std::vector<EchoSpan> pre_spans(pre_.line_count, before), post_spans(pre_.line_count, after);
  kernel("warp")(range, pre_device_, post_device_, queue_.array(pre_spans), queue_.array(post_spans), u, taps,
                 series, mean, difference, pair, kInterpolationPhases, lines, samples, grid, pad_.layout);
  const std::vector<float> m = queue_.read(mean), d = queue_.read(difference);
  const auto pre = as_reference(pre_), post = as_reference(post_);
  double worst = 0;
  for (int l = 0; l < lines; ++l)
    for (int k = 0; k < samples; ++k) {
      const double column = std::clamp(double(l - grid.first_line) / grid.line_step, 0.0, grid.nx - 1.0);
      const double row = std::clamp(double(k - grid.first_sample) / grid.sample_step, 0.0, grid.ny - 1.0);
      const reference::Shift u{0.3 * column - 0.7, 2.4 - 1.1 * row};
      const auto holds = [](const EchoSpan& span, double at) { return at >= span.first && at < span.end; };
      const bool seen =
          holds(before, k) && holds(after, k + u.samples) && l + u.lines >= 0 && l + u.lines < lines;
      const double own = seen ? pre.at(k, l) : 0, moved = seen ? reference::interpolate(post, k, l, u) : 0;
      const auto at = static_cast<std::size_t>(pad_.layout.origin + l * pad_.layout.stride + k);
      ASSERT_TRUE(std::isfinite(m[at]) && std::isfinite(d[at]));
      worst = std::max({worst, std::abs(m[at] - 0.5 * (own + moved)), std::abs(d[at] - (own - moved))});
    }
  EXPECT_LE(worst,
            100 * 1e-3);  // amplitude 100 rms; blending the tabulated taps is good to 1e-3 of the peaks
}

TEST_F(DisplacementKernels, MedianCuresHopsAndKeepsGradients) {
  const int nx = 11, ny = 9, hop = 4 + nx * 5, silent = 7 + nx * 2;
  std::vector<float> field, correlation(static_cast<std::size_t>(nx * ny), 0.95f);
  for (int j = 0; j < ny; ++j)
    for (int i = 0; i < nx; ++i) {
      field.push_back(0.1f * static_cast<float>(i));
      field.push_back(-2.0f * static_cast<float>(j));
    }
  const std::vector<float> prediction = field;
  field[2 * hop + 1] += 5.5f;
  correlation[silent] = 0.1f;
  field[2 * silent] = 40.0f;
  const Array<float> f = queue_.array(field), p = queue_.array(prediction), c = queue_.array(correlation);
  const Array<float> out = queue_.array<float>(field.size()),
                     deviation = queue_.array<float>(correlation.size());
  kernel("median_filter")(over(nx * ny), f, p, c, out, deviation, nx, ny, 2, 0.7f, 0.5f, 1.0f);
  const std::vector<float> cured = queue_.read(out), off = queue_.read(deviation);
  for (std::size_t n = 0; n < cured.size(); ++n) EXPECT_NEAR(cured[n], prediction[n], 1e-5) << n;
  EXPECT_NEAR(off[hop], 5.5, 1e-4);
  EXPECT_NEAR(off[0], 0, 1e-5);
}

TEST_F(DisplacementKernels, SmoothingKeepsUniformStrainUpToTheBorder) {
  const int nx = 7, ny = 5;
  std::vector<float> field;
  for (int n = 0; n < nx * ny; ++n) {
    field.push_back(0.3f * static_cast<float>(n % nx) - 0.2f * static_cast<float>(n / nx));
    field.push_back(1.0f - 1.5f * static_cast<float>(n / nx) + 0.1f * static_cast<float>(n % nx));
  }
  const Array<float> f = queue_.array(field), out = queue_.array<float>(field.size());
  kernel("smooth")(over(nx * ny), f, out, nx, ny);
  const std::vector<float> smooth = queue_.read(out);
  for (std::size_t n = 0; n < smooth.size(); ++n) EXPECT_NEAR(smooth[n], field[n], 1e-5) << n;
}

}  // namespace
}  // namespace teletact::service
