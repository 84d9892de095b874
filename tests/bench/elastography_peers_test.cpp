// Every peer of the elastography chart does what its paper says on easy pairs, so that the chart beats no
// straw man: a shift by parts of a sample, and uniform strain, with the lateral motion that goes with it
// where the method follows that.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "bench/peers/line_path.h"
#include "bench/peers/line_system.h"
#include "bench/peers/rf_nodes.h"
#include "bench/phantoms/metrics.h"

namespace teletact::bench {
namespace {

struct Promise {
  Tracker (*make)(TrackerOptions);
  double shift_rmse_m, shift_bias_m, lateral_rmse_m;  // lateral: infinite for a method that does not say
};

// The bias of parabolic peaks (T2.2) is of these methods, not of the test.
class ElastographyPeer : public ::testing::TestWithParam<Promise> {
 protected:
  Tracker peer_ = GetParam().make({});
};

TEST_P(ElastographyPeer, FindsAShiftByPartsOfASample) {
  const Phantom p = Phantoms::rigid({0.1e-3, 6.5e-6}, 30, .99, 1);
  const TrackErrors e = track_errors(peer_.track(p.pre, p.post, p.geometry), p);
  EXPECT_LE(e.axial_rmse_m, GetParam().shift_rmse_m) << peer_.name;
  EXPECT_LE(std::abs(e.bias_m), GetParam().shift_bias_m) << peer_.name;
  EXPECT_GE(e.valid_fraction, 0.99) << peer_.name;
  EXPECT_EQ(e.hop_fraction, 0) << peer_.name;
  if (std::isfinite(GetParam().lateral_rmse_m)) {
    EXPECT_LE(e.lateral_rmse_m, GetParam().lateral_rmse_m) << peer_.name;
  }
}

TEST_P(ElastographyPeer, FindsUniformStrain) {
  for (const double strain : {-0.01, 0.02}) {
    const bool follows_sideways = std::isfinite(GetParam().lateral_rmse_m);
    const Phantom p = Phantoms::uniform(strain, follows_sideways ? -strain / 2 : 0, 30, .99, 2);
    const Track t = peer_.track(p.pre, p.post, p.geometry);
    const TrackErrors e = track_errors(t, p);
    EXPECT_LE(e.axial_rmse_m, 2.5e-6) << peer_.name;
    EXPECT_LE(e.hop_fraction, 0.001) << peer_.name;
    std::vector<double> found;
    for (const double s : axial_strain(t, 2e-3, 2e-3))
      if (std::isfinite(s)) found.push_back(s);
    EXPECT_GE(found.size(), 0.9 * static_cast<double>(t.grid.size())) << peer_.name;
    EXPECT_NEAR(median_of(found), strain, 0.01 * std::abs(strain)) << peer_.name;
  }
}

const double kSaysNothing = std::numeric_limits<double>::infinity();
INSTANTIATE_TEST_SUITE_P(All, ElastographyPeer,
                         ::testing::Values(Promise{make_ncc_tracker, 1.5e-6, 1e-6, 25e-6},
                                           Promise{make_block_matcher, 1.5e-6, 1e-6, 25e-6},
                                           Promise{make_glue_tracker, 0.5e-6, 0.2e-6, 10e-6},
                                           Promise{make_loupas_tracker, 1.3e-6, 0.2e-6, kSaysNothing}));

TEST(NccTracker, FindsThePeakThatTheReferenceFinds) {
  const Phantom p = Phantoms::uniform(-0.02, 0.01, 20, .95, 3);
  TrackerOptions options;
  const Track t = make_ncc_tracker(options).track(p.pre, p.post, p.geometry);
  const Nodes nodes(p.pre, p.geometry, options.grid_dx_m, options.grid_dy_m);
  const reference::RfImage pre = image_of(p.pre), post = image_of(p.post);
  const reference::Window window = nodes.window(options.window_axial_m, options.window_lateral_m);
  int agree = 0, asked = 0;
  for (int j = 10; j < nodes.grid.ny - 3; j += 17)
    for (int i = 5; i < nodes.grid.nx - 3; i += 23) {
      double best = -2;
      int axial = 0;
      for (int l = -4; l <= 4; ++l)
        for (int a = -60; a <= 60; ++a)
          if (const double c = reference::normalised_cross_correlation(pre, post, nodes.sample(j),
                                                                       nodes.line(i), window, a, l);
              c > best)
            best = c, axial = a;
      ++asked;
      agree += std::abs(t.axial_m[nodes.at(i, j)] / nodes.sample_m - axial) <= 1.01;
    }
  EXPECT_EQ(agree, asked);
  EXPECT_GT(asked, 20);
}

TEST(LinePaths, FollowAJumpThatNoneOfTheSamplesDecidesAlone) {
  // Two lines of noise, moved by 3 samples and one line: the path may cost nothing else.
  reference::RfImage pre{400, 6, {}}, post{400, 6, {}};
  std::vector<double> noise(3000);
  unsigned state = 1;
  for (double& v : noise)
    state = state * 1664525u + 1013904223u, v = static_cast<int>(state >> 16) % 256 / 128.0 - 1;
  for (int l = 0; l < 6; ++l)
    for (int k = 0; k < 400; ++k) {
      pre.values.push_back(noise[static_cast<std::size_t>(k + 10 + 420 * l)]);
      post.values.push_back(l > 0 && k >= 3 ? noise[static_cast<std::size_t>(k - 3 + 10 + 420 * (l - 1))]
                                            : 0);
    }
  const Paths paths = find_line_paths(pre, post, {8, 2, 0.05, 0, 0.2});
  for (int l = 0; l < 4; ++l)
    for (int k = 100; k < 380; ++k) {
      EXPECT_EQ(paths.axial[static_cast<std::size_t>(k + 400 * l)], 3);
      EXPECT_EQ(paths.lateral[static_cast<std::size_t>(k + 400 * l)], 1);
    }
}

TEST(LineSystem, SolvesTheEquationsItStates) {
  // The gradient of the stated energy is zero at the solution.
  constexpr int kSamples = 7, kLines = 5, kCount = kSamples * kLines;
  const RegularisationWeights w{.axial_1 = 2, .axial_2 = 0.3, .lateral_1 = 1, .lateral_2 = 0.7};
  LineSystem system(kSamples, kLines, w);
  std::vector<double> axial(kCount), lateral(kCount), slope_a(kCount), slope_l(kCount), residual(kCount);
  for (int n = 0; n < kCount; ++n) {
    const auto k = static_cast<std::size_t>(n);
    axial[k] = std::sin(1.3 * n), lateral[k] = std::cos(0.7 * n), slope_a[k] = std::sin(2.1 * n + 1);
    slope_l[k] = 0.2 * std::cos(3.3 * n), residual[k] = std::sin(0.4 * n * n);
    system.add_datum(k, slope_a[k], slope_l[k], residual[k]);
  }
  system.add_smoothness_of(axial, lateral);
  const std::vector<double> step = system.solve();
  const auto energy = [&](const std::vector<double>& s) {
    double sum = 0;
    for (int l = 0; l < kLines; ++l)
      for (int k = 0; k < kSamples; ++k) {
        const auto n = static_cast<std::size_t>(k + kSamples * l);
        const auto a = [&](std::size_t m) { return axial[m] + s[2 * m]; };
        const auto b = [&](std::size_t m) { return lateral[m] + s[2 * m + 1]; };
        sum += std::pow(residual[n] - slope_a[n] * s[2 * n] - slope_l[n] * s[2 * n + 1], 2);
        if (k + 1 < kSamples)
          sum += w.axial_1 * std::pow(a(n) - a(n + 1), 2) + w.lateral_1 * std::pow(b(n) - b(n + 1), 2);
        if (l + 1 < kLines)
          sum += w.axial_2 * std::pow(a(n) - a(n + kSamples), 2) +
                 w.lateral_2 * std::pow(b(n) - b(n + kSamples), 2);
      }
    return sum;
  };
  for (std::size_t n = 0; n < step.size(); ++n) {
    std::vector<double> more = step, less = step;
    more[n] += 1e-4, less[n] -= 1e-4;
    EXPECT_NEAR((energy(more) - energy(less)) / 2e-4, 0, 1e-5) << n;
  }
}

}  // namespace
}  // namespace teletact::bench
