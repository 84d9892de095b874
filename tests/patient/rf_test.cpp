#include "client/patient/rf.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

namespace teletact::client {
namespace {

// 40 x 30 mm of tissue under a 20 mm probe with 85 lines; made once.
struct World {
  World() {
    tissue.width_m = .04, tissue.depth_m = .03;
    tissue.inclusions = {{.02, .013, .008, 5}};
    tissue.probe.width_m = .02, tissue.probe.lines = 85;
    const Patient patient(tissue);
    state = patient.press(.01, 3e-4);
    base = simulate_rf(tissue, state, RfFrame::kProbe, 11);
  }
  Tissue tissue;
  ProbeState state;
  RfBase base;
};

const World& world() {
  static const World w;
  return w;
}

template <class T>
double correlation(const std::vector<T>& a, std::size_t at_a, const std::vector<T>& b, std::size_t at_b,
                   std::size_t n) {
  double ab = 0, aa = 0, bb = 0;
  for (std::size_t i = 0; i < n; ++i) {
    const double x = a[at_a + i], y = b[at_b + i];
    ab += x * y, aa += x * x, bb += y * y;
  }
  return ab / std::sqrt(aa * bb);
}

template <class T>
double correlation(const std::vector<T>& a, const std::vector<T>& b) {
  return correlation(a, 0, b, 0, a.size());
}

double rms(const std::vector<double>& v) {
  double sum = 0;
  for (const double x : v) sum += x * x;
  return std::sqrt(sum / static_cast<double>(v.size()));
}

// Noise of a pass in units of the speckle.
std::vector<double> noise_of(const RfPair& pair, const RfBase& base) {
  std::vector<double> n(pair.pre.size());
  for (std::size_t i = 0; i < n.size(); ++i)
    n[i] = pair.pre[i] / kSpeckleCounts - static_cast<double>(base.pre[i]);
  return n;
}

TEST(Rf, CoversTheWindowInTheStatedGeometry) {
  const RfGeometry& g = world().base.geometry;
  EXPECT_EQ(g.line_count, 85u);
  EXPECT_DOUBLE_EQ(g.sample_pitch_m, 1540 / 80e6);
  EXPECT_DOUBLE_EQ(g.first_line_x_m, .01 + .02 / 85 / 2);
  EXPECT_NEAR(static_cast<double>(g.sample_count) * g.sample_pitch_m, .03, g.sample_pitch_m);
  EXPECT_EQ(world().base.pre.size(), g.values());
}

TEST(Rf, SpeckleIsFullyDeveloped) {
  const RfBase& base = world().base;
  const std::size_t samples = base.geometry.sample_count;
  // Envelope by a windowed Hilbert transformer.
  constexpr int kHalf = 40;
  double sum = 0, squares = 0, count = 0;
  for (std::size_t l = 5; l + 5 < base.geometry.line_count; ++l)
    for (std::size_t k = 100; k + 100 < samples; k += 3) {
      const float* rf = &base.pre[samples * l + k];
      double quadrature = 0;
      for (int t = 1; t <= kHalf; t += 2)
        quadrature += 2 / (std::numbers::pi * t) * (.54 + .46 * std::cos(std::numbers::pi * t / kHalf)) *
                      (rf[-t] - rf[t]);
      const double envelope = std::hypot(rf[0], quadrature);
      sum += envelope, squares += envelope * envelope, count += 1;
    }
  const double mean = sum / count;
  EXPECT_NEAR(mean / std::sqrt(squares / count - mean * mean), 1.913, .06);
}

// Power of line 40 .. 44 at a frequency, Hann-windowed.
double power_at(const std::vector<double>& rf, std::size_t samples, double cycles_per_sample) {
  double power = 0;
  for (std::size_t l = 20; l < 60; ++l) {
    std::complex<double> sum = 0;
    for (std::size_t k = 0; k < samples; ++k) {
      const double window =
          .5 - .5 * std::cos(2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(samples));
      sum += window * rf[samples * l + k] *
             std::polar(1.0, -2 * std::numbers::pi * cycles_per_sample * static_cast<double>(k));
    }
    power += std::norm(sum);
  }
  return power;
}

TEST(Rf, SpectrumFallsByHalfAtTheBandEdges) {
  const RfBase& base = world().base;
  const std::vector<double> rf(base.pre.begin(), base.pre.end());
  const auto band = [&](double hz) {  // average over neighbouring bins: one speckle realisation
    double p = 0;
    for (int k = -10; k <= 10; ++k) p += power_at(rf, base.geometry.sample_count, (hz + 25e3 * k) / 40e6);
    return p;
  };
  const double centre = band(7.3e6), low = band(7.3e6 * .7), high = band(7.3e6 * 1.3);
  EXPECT_NEAR(10 * std::log10(low / centre), -6.02, 1.2);
  EXPECT_NEAR(10 * std::log10(high / centre), -6.02, 1.2);
}

TEST(Rf, LateralPsfHasTheStatedWidth) {
  const RfBase& base = world().base;
  const std::size_t n = base.geometry.sample_count * (base.geometry.line_count - 1);
  const double sigma = base.ultrasound.wavelength_m() * base.ultrasound.f_number / 2.3548;
  const double pitch = base.geometry.line_pitch_m;
  const double measured = correlation(base.pre, 0, base.pre, base.geometry.sample_count, n);
  EXPECT_NEAR(measured, std::exp(-pitch * pitch / (4 * sigma * sigma)), .02);
}

// Axial displacement by plain NCC: 2.3 mm windows, integer lags, parabola. Errors against `truth` over a
// grid.
template <class Truth>
std::vector<double> ncc_errors(const RfBase& base, double search_m, Truth truth) {
  const RfGeometry& g = base.geometry;
  constexpr std::size_t kWindow = 121;
  const auto range = static_cast<std::ptrdiff_t>(search_m / g.sample_pitch_m);
  std::vector<double> errors;
  for (std::size_t l = 10; l + 10 < g.line_count; l += 7)
    for (std::size_t k = 100; k + kWindow + 100 < g.sample_count; k += 60) {
      const std::size_t at = g.sample_count * l + k;
      const auto score = [&](std::ptrdiff_t lag) {
        return correlation(base.pre, at, base.post,
                           static_cast<std::size_t>(static_cast<std::ptrdiff_t>(at) + lag), kWindow);
      };
      std::ptrdiff_t best = -range;
      double most = -2;
      for (std::ptrdiff_t lag = -range; lag <= range; ++lag)
        if (const double s = score(lag); s > most) most = s, best = lag;
      const double left = score(best - 1), right = score(best + 1);
      const double lag = static_cast<double>(best) + .5 * (left - right) / (left - 2 * most + right);
      const double x = g.first_line_x_m + static_cast<double>(l) * g.line_pitch_m;
      const double y = (static_cast<double>(k) + (kWindow - 1) / 2.0) * g.sample_pitch_m;
      errors.push_back(std::abs(lag * g.sample_pitch_m - truth(x, y)));
    }
  std::sort(errors.begin(), errors.end());
  return errors;
}

TEST(Rf, PostIsPreMovedByTheDisplacementInTheProbesFrame) {
  const World& w = world();
  const auto errors =
      ncc_errors(w.base, 4e-4, [&](double x, double y) { return w.state.field->at(x, y).y - 3e-4; });
  EXPECT_LE(errors[errors.size() / 2], 3e-6);
  EXPECT_LE(errors[errors.size() * 9 / 10], 10e-6);
}

// Tissue that goes with the probe, which tilts, has not moved for it.
TEST(Rf, TheProbesFrameTiltsWithIt) {
  const World& w = world();
  ProbeState state = w.state;
  state.tilt = .1 * state.compression_m / (state.width_m / 2);
  struct WithTheProbe : DisplacementField {
    explicit WithTheProbe(const ProbeState& of) : probe(of) {}
    Vector at(double x_m, double y_m, double) const override { return probe.motion(x_m, y_m); }
    const ProbeState& probe;
  };
  ProbeState moved = state;
  moved.field = std::make_shared<WithTheProbe>(state);
  const RfBase base = simulate_rf(w.tissue, moved, RfFrame::kProbe, 11);
  EXPECT_GE(correlation(base.pre, base.post), 1 - 1e-6);
  EXPECT_LE(correlation(base.pre, simulate_rf(w.tissue, moved, RfFrame::kLab, 11).post), .5);
}

// Tissue that has moved on one side of z = 5 mm alone is seen to have moved by a probe there.
TEST(Rf, ImagesThePlaneThatTheProbeStandsOn) {
  struct Beyond : DisplacementField {
    Vector at(double, double, double z_m) const override { return {0, z_m > .005 ? 5e-5 : 0, 0}; }
  };
  ProbeState state = world().state;
  state.field = std::make_shared<Beyond>();
  Tissue t = world().tissue;
  t.ultrasound.elevation_beam_m = .001;
  const RfBase here = simulate_rf(t, state, RfFrame::kLab, 11);
  state.window_z_m = .01;
  const RfBase there = simulate_rf(t, state, RfFrame::kLab, 11);
  EXPECT_GE(correlation(here.pre, here.post), 1 - 1e-6);
  EXPECT_LE(correlation(there.pre, there.post), .2);
}

// The tissue of world() with such a beam, moved across the image plane alone.
RfBase moved_across(const Ultrasound& ultrasound, double across_m) {
  Tissue t = world().tissue;
  t.ultrasound = ultrasound;
  struct Across : DisplacementField {
    explicit Across(double by_m) : across_m(by_m) {}
    Vector at(double, double, double) const override { return {0, 0, across_m}; }
    double across_m;
  };
  ProbeState state = world().state;
  state.field = std::make_shared<Across>(across_m);
  return simulate_rf(t, state, RfFrame::kLab, 12);
}

// A beam of FWHM b, both echoes of one scatterer weighted by exp(-z^2 / 2 s^2): the echoes' correlation is
// exp(-d^2 / 4 s^2), s = b / 2.355.
TEST(Rf, SpeckleDecorrelatesAsScatterersLeaveThePlane) {
  Ultrasound u;
  u.elevation_beam_m = .001;
  for (const double across_m : {0.0, .0002, .0005}) {
    const RfBase base = moved_across(u, across_m);
    const double s = u.elevation_beam_m / 2.3548;
    EXPECT_NEAR(correlation(base.pre, base.post), std::exp(-across_m * across_m / (4 * s * s)), .02)
        << across_m;
  }
  const RfBase thin = moved_across({}, .0005);
  EXPECT_EQ(thin.pre, thin.post) << "only the plane echoes";
}

// Correlation of neighbouring lines about a depth.
double between_lines(const RfBase& base, double depth_m) {
  const RfGeometry& g = base.geometry;
  const auto half = static_cast<std::size_t>(.002 / g.sample_pitch_m);
  const std::size_t first = static_cast<std::size_t>(depth_m / g.sample_pitch_m) - half;
  double sum = 0;
  for (std::size_t l = 0; l + 1 < g.line_count; ++l)
    sum += correlation(base.pre, g.sample_count * l + first, base.pre, g.sample_count * (l + 1) + first,
                       2 * half);
  return sum / static_cast<double>(g.line_count - 1);
}

TEST(Rf, BeamIsWiderOutOfFocusAndAsLoud) {
  Ultrasound u;
  u.focus_m = .012, u.beam_growth = 1;
  for (const double elevation_m : {0.0, .001}) {
    u.elevation_beam_m = elevation_m;
    const RfBase base = moved_across(u, 0);
    const double pitch = base.geometry.line_pitch_m, sigma = u.wavelength_m() * u.f_number / 2.3548;
    for (const double depth_m : {.004, .012, .026}) {
      const double wide = sigma * std::hypot(1, depth_m / .012 - 1);
      EXPECT_NEAR(between_lines(base, depth_m), std::exp(-pitch * pitch / (4 * wide * wide)), .06) << depth_m;
    }
    const auto loudness = [&](double depth_m) {
      const RfGeometry& g = base.geometry;
      double sum = 0;
      for (std::size_t l = 0; l < g.line_count; ++l)
        for (int k = -150; k < 150; ++k)
          sum += std::pow(
              base.pre[g.sample_count * l + static_cast<std::size_t>(depth_m / g.sample_pitch_m + k)], 2);
      return std::sqrt(sum);
    };
    EXPECT_NEAR(loudness(.026) / loudness(.012), 1, .15);
  }
}

TEST(Rf, AttenuationLowersThePulseAndLiftsTheNoise) {
  Tissue t = world().tissue;
  t.ultrasound.attenuation_db_cm_mhz = .7;
  const RfBase base = simulate_rf(t, world().state, RfFrame::kProbe, 11);
  const RfGeometry& g = base.geometry;
  // Mean frequency about a depth, by the phase between a sample and the next: cos = r1 / r0 for a narrow
  // band.
  const auto frequency = [&](double depth_m) {
    double r0 = 0, r1 = 0;
    for (std::size_t l = 0; l < g.line_count; ++l)
      for (int k = -200; k < 200; ++k) {
        const float* rf =
            &base.pre[g.sample_count * l + static_cast<std::size_t>(depth_m / g.sample_pitch_m + k)];
        r0 += rf[0] * rf[0], r1 += rf[0] * rf[1];
      }
    return std::acos(r1 / r0) / (2 * std::numbers::pi) * t.ultrasound.sampling_frequency_hz;
  };
  const double lower = frequency(.005) - frequency(.025);
  EXPECT_NEAR(lower / (centre_frequency_hz(t.ultrasound, .005) - centre_frequency_hz(t.ultrasound, .025)), 1,
              .25);
  EXPECT_NEAR(centre_frequency_hz(t.ultrasound, .025), 6.0e6, .2e6);
  const auto noise = noise_of(with_noise(base, 3), base);
  EXPECT_NEAR(20 * std::log10(rms(noise)), -30, .3) << "over the frame as stated";
  const auto level = [&](double depth_m) {
    double sum = 0;
    for (std::size_t l = 0; l < g.line_count; ++l)
      for (int k = -200; k < 200; ++k)
        sum +=
            std::pow(noise[g.sample_count * l + static_cast<std::size_t>(depth_m / g.sample_pitch_m + k)], 2);
    return 10 * std::log10(sum);
  };
  EXPECT_NEAR(level(.025) - level(.005), .7 * 2 * 2 * 7.3, 1) << "dB over 2 cm, there and back";
}

TEST(Rf, LabFrameKeepsTheFarSide) {
  const World& w = world();
  const RfBase lab = simulate_rf(w.tissue, w.state, RfFrame::kLab, 11);
  EXPECT_EQ(lab.pre, w.base.pre);
  const auto errors = ncc_errors(lab, 4e-4, [&](double x, double y) { return w.state.field->at(x, y).y; });
  EXPECT_LE(errors[errors.size() / 2], 3e-6);
}

TEST(Rf, SeedsDecideEverything) {
  const World& w = world();
  const RfBase again = simulate_rf(w.tissue, w.state, RfFrame::kProbe, 11);
  const RfBase other = simulate_rf(w.tissue, w.state, RfFrame::kProbe, 12);
  EXPECT_EQ(again.pre, w.base.pre);
  EXPECT_EQ(again.post, w.base.post);
  EXPECT_LE(std::abs(correlation(other.pre, w.base.pre)), .05);
  EXPECT_EQ(with_noise(w.base, 1).post, with_noise(w.base, 1).post);
  EXPECT_NE(with_noise(w.base, 1).post, with_noise(w.base, 2).post);
  EXPECT_LE(
      std::abs(correlation(noise_of(with_noise(w.base, 1), w.base), noise_of(with_noise(w.base, 2), w.base))),
      .02);
}

TEST(Rf, NoiseHasTheStatedLevelAndBand) {
  for (const double snr_db : {10.0, 30.0}) {
    RfBase base = world().base;
    base.ultrasound.snr_db = snr_db;
    const auto noise = noise_of(with_noise(base, 3), base);
    EXPECT_NEAR(20 * std::log10(rms(noise)), -snr_db, .1);
    const std::size_t samples = base.geometry.sample_count;
    const double inside = power_at(noise, samples, 7.3 / 40);
    EXPECT_LE(power_at(noise, samples, 1.2 / 40), .01 * inside);
    EXPECT_LE(power_at(noise, samples, 14.5 / 40), .01 * inside);
    EXPECT_NEAR(power_at(noise, samples, 4.5 / 40) / inside, 1, .6) << "white within it";
  }
}

TEST(Rf, DecorrelationIsAsAsked) {
  for (const double rho : {1.0, .95, .5, 0.0}) {
    RfBase base = world().base;
    base.ultrasound.snr_db = 200;
    base.ultrasound.correlation = rho;
    const RfPair pair = with_noise(base, 4);
    const std::vector<double> post(pair.post.begin(), pair.post.end()),
        moved(base.post.begin(), base.post.end());
    EXPECT_NEAR(correlation(post, moved), rho, .03) << rho;
    EXPECT_NEAR(rms(post) / kSpeckleCounts, 1, .05) << rho;
  }
}

TEST(Rf, IndependentSpeckleHasTheSamePsf) {
  RfBase base = world().base;
  base.ultrasound.snr_db = 200;
  base.ultrasound.correlation = 0;
  const RfPair pair = with_noise(base, 5);
  const std::vector<float> other(pair.post.begin(), pair.post.end());
  const std::size_t samples = base.geometry.sample_count, n = samples * (base.geometry.line_count - 3);
  for (const std::size_t lag : {std::size_t{1}, std::size_t{3}, std::size_t{6}, samples, 2 * samples})
    EXPECT_NEAR(correlation(other, 0, other, lag, n), correlation(base.pre, 0, base.pre, lag, n), .03) << lag;
}

}  // namespace
}  // namespace teletact::client
