// The chart's phantoms, bounds and measures say what they claim.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>

#include "bench/phantoms/bounds.h"
#include "bench/phantoms/metrics.h"

namespace teletact::bench {
namespace {

client::Ultrasound ultrasound(double f0_hz, double bandwidth, double snr_db, double correlation) {
  client::Ultrasound u;
  u.center_frequency_hz = f0_hz, u.bandwidth = bandwidth, u.snr_db = snr_db, u.correlation = correlation;
  return u;
}

// Kernel of `cycles`, m.
double cycles(const client::Ultrasound& u, double count) {
  return count * u.sound_speed_m_s / (2 * u.center_frequency_hz);
}

TEST(Bounds, FlatBandGivesTheFiguresOfT25) {
  const auto nanoseconds = [](const client::Ultrasound& u, double count) {
    return 2e9 * flat_displacement_bound_m(u, cycles(u, count)) / u.sound_speed_m_s;
  };
  EXPECT_NEAR(nanoseconds(ultrasound(5e6, .5, 20, 1), 10), 1.412, 2e-3);
  EXPECT_NEAR(nanoseconds(ultrasound(7.3e6, .6, 25, .99), 12), 0.926, 2e-3);
  EXPECT_NEAR(nanoseconds(ultrasound(7.3e6, .6, 40, .95), 12), 1.863, 2e-3);
}

TEST(Bounds, IntegralOfAGaussianBandIsBelowTheFlatOne) {
  const client::Ultrasound u = ultrasound(7.3e6, .6, 30, .99);
  const double ratio = displacement_bound_m(u, 1.6e-3) / flat_displacement_bound_m(u, 1.6e-3);
  EXPECT_GE(ratio, 0.72);
  EXPECT_LE(ratio, 0.79);
}

TEST(Bounds, StrainFilterIsABandPass) {
  const client::Ultrasound u = ultrasound(7.3e6, .6, 30, .99);
  const auto filter = [&](double strain) { return strain_filter(u, strain, 1.6e-3, 2e-3, 1, false); };
  EXPECT_LT(filter(1e-4), filter(5e-3));
  EXPECT_LT(filter(5e-2), filter(5e-3));
  EXPECT_GT(strain_filter(u, 5e-2, 1.6e-3, 2e-3, 1, true), filter(5e-2));
  EXPECT_NEAR(independent_lines(u, 1.0, 5), 5, 1e-9);
  EXPECT_NEAR(independent_lines(u, 1e-9, 5), 1, 1e-3);
}

TEST(Phantoms, RigidAndUniformTruthIsWhatWasAsked) {
  const Phantom shift = Phantoms::rigid({1e-4, -7e-6}, 30, .99, 1);
  EXPECT_NEAR(shift.displacement_m(0.02, 0.03).x, 1e-4, 1e-12);
  EXPECT_NEAR(shift.displacement_m(0.05, 0.001).y, -7e-6, 1e-12);
  const Phantom uniform = Phantoms::uniform(-.02, .01, 30, .99, 1);
  EXPECT_NEAR(uniform.axial_strain(0.01, 0.02), -.02, 1e-9);
  EXPECT_NEAR(uniform.displacement_m(0.04, 0.02).x, 1e-4, 1e-12);
  EXPECT_EQ(uniform.pre.line_count, 256u);
}

TEST(Phantoms, TheSameSeedIsTheSamePairAndNoiseIsAsAsked) {
  Phantoms phantoms;
  PhantomCase noisy;
  noisy.snr_db = 10;
  const Phantom a = phantoms.make({}, 4), b = phantoms.make(noisy, 4), again = phantoms.make({}, 4);
  EXPECT_EQ(a.pre.samples, again.pre.samples);
  EXPECT_EQ(a.post.samples, again.post.samples);
  double signal = 0, noise = 0;
  for (std::size_t n = 0; n < a.pre.samples.size(); ++n) {
    signal += std::pow(a.pre.samples[n], 2);
    noise += std::pow(b.pre.samples[n] - a.pre.samples[n], 2);
  }
  // The same noise at 10 dB less that at 30 dB.
  EXPECT_NEAR(std::sqrt(noise / signal), std::pow(10, -.5) - std::pow(10, -1.5), 0.01);
  EXPECT_GT(a.force_n, 0);
}

// The true displacement on a grid of 0.45 x 0.4 mm, moved by `error`.
Track truth_with(const Phantom& p, const std::function<double()>& error) {
  Track t;
  t.grid = {128, 98, 0.35e-3, 0.35e-3, 0.46e-3, 0.4e-3};
  for (std::size_t n = 0; n < t.grid.size(); ++n) {
    const Vector u = p.displacement_m(t.grid.origin_x_m + static_cast<double>(n % t.grid.nx) * t.grid.dx_m,
                                      t.grid.origin_y_m + static_cast<double>(n / t.grid.nx) * t.grid.dy_m);
    t.axial_m.push_back(u.y + error());
    t.lateral_m.push_back(u.x);
    t.valid.push_back(1);
    t.std_m.push_back(1e-6);
  }
  return t;
}

TEST(Measures, OfErrorsAreThoseThatWerePutIn) {
  Phantoms phantoms;
  const Phantom p = phantoms.make({}, 1);
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal(0.2e-6, 2e-6);
  Track t = truth_with(p, [&] { return normal(random); });
  const TrackErrors e = track_errors(t, p);
  EXPECT_NEAR(e.axial_rmse_m, 2.01e-6, 0.05e-6);
  EXPECT_NEAR(e.bias_m, 0.2e-6, 0.05e-6);
  EXPECT_NEAR(e.axial_p95_m, 1.96 * 2e-6, 0.2e-6);
  EXPECT_NEAR(e.lateral_rmse_m, 0, 1e-12);
  EXPECT_EQ(e.hop_fraction, 0);
  const Calibration z = standardised_errors(t, p);
  EXPECT_NEAR(z.inside, 2, 0.2);
  EXPECT_NEAR(z.outside, 2, 0.05);
  t.axial_m[64 + 128 * 50] += 60e-6;  // one hop
  EXPECT_GT(track_errors(t, p).hop_fraction, 0);
}

TEST(Measures, EdgeWidthIsThatOfTheBlurAndGrowsWithTheKernel) {
  Phantoms phantoms;
  const Phantom p = phantoms.make({}, 1);
  const Track t = truth_with(p, [] { return 0.0; });
  double last = 0;
  for (const double kernel_m : {1.2e-3, 2e-3, 2.8e-3, 3.6e-3}) {
    const EdgeWidth w = edge_width(axial_strain(t, kernel_m, 0.5e-3), t.grid, p);
    EXPECT_GT(w.axial_m, last);
    // A parabola's slope weights over the kernel: standard deviation kernel / sqrt(20), 1.68 of it 20 to 80
    // %.
    EXPECT_NEAR(w.axial_m, 1.683 * kernel_m / std::sqrt(20), 0.2e-3) << kernel_m;
    last = w.axial_m;
  }
  EXPECT_GT(edge_width(axial_strain(t, 2e-3, 3e-3), t.grid, p).lateral_m,
            edge_width(axial_strain(t, 2e-3, 1.2e-3), t.grid, p).lateral_m + 0.3e-3);
}

TEST(Measures, SnreIsStrainOverItsNoise) {
  Phantoms phantoms;
  const Phantom p = phantoms.make({}, 1);
  const Track t = truth_with(p, [] { return 0.0; });
  const auto truth = true_axial_strain(t.grid, p);
  std::mt19937_64 random(2);
  std::normal_distribution<double> normal(0, 5e-4);
  std::vector<double> strain = truth;
  for (double& s : strain) s += normal(random);
  const StrainQuality q = strain_quality(strain, truth, t.grid, p);
  const double beside = std::abs(p.axial_strain(p.inclusion_x_m - 0.012, p.inclusion_y_m));
  EXPECT_NEAR(q.snre, beside / 5e-4, 0.1 * beside / 5e-4);
  EXPECT_NEAR(q.rmse, 5e-4, 2e-5);
  EXPECT_GT(q.cnre, 5);
  std::fill(strain.begin(), strain.end(), std::nan(""));
  EXPECT_TRUE(std::isnan(strain_quality(strain, truth, t.grid, p).snre));
}

TEST(Measures, OfTheModulus) {
  Phantom p;
  p.inclusion_x_m = p.inclusion_y_m = 0.02, p.diameter_m = 0.01, p.contrast = 3;
  const service::ImageGrid g{100, 100, 0, 0, 0.4e-3, 0.4e-3};
  std::vector<float> e(g.size());
  for (std::size_t n = 0; n < e.size(); ++n)
    e[n] = p.radii(static_cast<double>(n % 100) * g.dx_m, static_cast<double>(n / 100) * g.dy_m) <= 1 ? 27e3f
                                                                                                      : 9e3f;
  ModulusQuality q = modulus_quality(e, g, p);
  EXPECT_NEAR(q.contrast, 3, 1e-6);
  EXPECT_NEAR(q.dice, 1, 1e-12);
  EXPECT_NEAR(q.background, 9e3, 1e-3);
  for (std::size_t n = 0; n < e.size(); ++n)
    if (n % 100 > 50) e[n] = 9e3f;  // half of the disc missed
  q = modulus_quality(e, g, p);
  EXPECT_NEAR(q.dice, 2.0 / 3, 0.05);
}

// What one map leaves out far from the inclusion is not held against another; what it leaves out in it is
// held against itself.
TEST(Measures, JudgeEveryMapOnTheSameNodes) {
  Phantom p;
  p.inclusion_x_m = p.inclusion_y_m = 0.02, p.diameter_m = 0.01, p.contrast = 3;
  const service::ImageGrid g{100, 100, 0, 0, 0.4e-3, 0.4e-3};
  std::vector<float> careful(g.size()), bold;
  for (std::size_t n = 0; n < careful.size(); ++n)
    careful[n] = p.radii(static_cast<double>(n % 100) * g.dx_m, static_cast<double>(n / 100) * g.dy_m) <= 1
                     ? 27e3f
                     : 9e3f;
  bold = careful;
  for (std::size_t n = 0; n < careful.size(); ++n)
    if (n / 100 > 90) careful[n] = std::nanf(""), bold[n] = 90e3f;
  double disc = 0;
  for (const float v : careful) disc += v > 10e3f;
  EXPECT_NEAR(modulus_quality(bold, g, p).dice, 2 * disc / (2 * disc + 900),
              1e-12);  // nine rows too many: 0.52
  const auto judged = judged_nodes({careful, bold}, g, p);
  EXPECT_NEAR(modulus_quality(bold, g, p, judged).dice, 1, 1e-12);
  EXPECT_NEAR(modulus_quality(careful, g, p, judged).dice, 1, 1e-12);
  for (std::size_t n = 0; n < careful.size(); ++n)
    if (n % 100 > 50) careful[n] = std::nanf("");
  const auto with_hole = judged_nodes({careful, bold}, g, p);
  EXPECT_NEAR(modulus_quality(bold, g, p, with_hole).dice, 1, 1e-12);
  EXPECT_LT(modulus_quality(careful, g, p, with_hole).dice, 0.75);
}

TEST(Measures, IntervalsAndThresholds) {
  const Interval i = interval95({1, 2, 3, 4, 5});
  EXPECT_NEAR(i.mean, 3, 1e-12);
  EXPECT_NEAR(i.half_width, 2.776 * std::sqrt(2.5 / 5), 1e-9);
  EXPECT_TRUE(std::isnan(interval95({1}).half_width));
  EXPECT_TRUE(std::isnan(median_of<double>({})));
  const double threshold = otsu_threshold({0, .1, -.1, 5, 5.1, 4.9, 0});
  EXPECT_GT(threshold, .1);
  EXPECT_LT(threshold, 4.9);
}

}  // namespace
}  // namespace teletact::bench
