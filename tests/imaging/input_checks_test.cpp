// What a request states about its frames, against the frames.
#include "service/imaging/tracking/input_checks.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "service/imaging/estimate.h"
#include "tests/imaging/imaging_device.h"
#include "tests/imaging/speckle.h"

namespace teletact::service {
namespace {

constexpr double kStrain = -0.012, kDepthM = 0.020;
constexpr std::size_t kSamples = 1039, kLines = 85;  // 20 x 20 mm

Speckle tissue(double snr_db) {
  SpeckleOptions options;
  options.samples = kSamples;
  options.lines = kLines;
  options.snr_db = snr_db;
  options.correlation = 0.99;
  return Speckle(options);
}

// A pair whose side at `rest_y_m` rests.
std::vector<std::string> warnings(double rest_y_m, const AcquisitionGeometry& geometry) {
  static const Speckle speckle = tissue(30);
  static Elastography elastography(imaging_device());
  const RfFrame pre = speckle.frame([](double, double) { return std::pair{0.0, 0.0}; }, 1);
  const RfFrame post = speckle.frame(
      [=](double, double y) {
        return std::pair{0.0, kStrain * (y - rest_y_m)};
      },
      2);
  const TissueExtent extent{static_cast<double>(kLines) * geometry.line_pitch_m, kDepthM, 0, 0.0};
  const Estimate e = elastography.estimate(
      pre, post, {geometry, std::nullopt, extent, {}, {ModulusKind::kReferenceStress, {}}});
  std::vector<std::string> lines;
  for (const Warning& warning : e.input_warnings) lines.push_back(warning.line());
  return lines;
}

// Noise of a Gaussian band, -6 dB width 60 % of its centre, in white noise.
RfFrame band(double center_hz, double fs_hz, double snr_db) {
  constexpr std::size_t kCount = 2000, kTaps = 60;
  std::mt19937_64 random(7);
  std::normal_distribution<double> normal;
  const double spread_s = std::sqrt(2 * std::log(2.0)) / (std::numbers::pi * 0.6 * center_hz);
  RfFrame frame{kCount, 8, {}};
  for (std::size_t l = 0; l < frame.line_count; ++l) {
    std::vector<double> white(kCount + 2 * kTaps), line(kCount, 0.0);
    for (double& w : white) w = normal(random);
    double power = 0;
    for (std::size_t k = 0; k < kCount; ++k) {
      for (std::size_t t = 0; t <= 2 * kTaps; ++t) {
        const double s = (static_cast<double>(t) - kTaps) / fs_hz;
        line[k] += white[k + t] * std::exp(-s * s / (2 * spread_s * spread_s)) *
                   std::cos(2 * std::numbers::pi * center_hz * s);
      }
      power += line[k] * line[k] / kCount;
    }
    const double noise = std::sqrt(power * std::pow(10, -snr_db / 10));
    for (const double v : line) frame.samples.push_back(static_cast<float>(v + noise * normal(random)));
  }
  return frame;
}

TEST(InputChecks, MeanFrequencyIsThatOfTheEchoWhateverTheNoise) {
  for (const double fs_hz : {40e6, 100e6})
    for (const double center_hz : {2.5e6, 3.5e6, 5e6, 7.3e6, 10e6})
      for (const double snr_db : {5.0, 10.0, 40.0})
        EXPECT_NEAR(mean_frequency(band(center_hz, fs_hz, snr_db), fs_hz) / center_hz, 1, 0.15)
            << center_hz << " of " << fs_hz << " at " << snr_db << " dB";
  EXPECT_TRUE(std::isnan(mean_frequency({64, 2, std::vector<float>(128, 3.f)}, 40e6)));
}

// A crop with a few loud echoes has the frequency of the whole.
TEST(InputChecks, FewLoudEchoesDoNotDecideTheMeanFrequency) {
  constexpr double kHz = 7e6, kFs = 40e6;
  RfFrame frame = band(kHz, kFs, 40);
  const RfFrame loud = band(0.6 * kHz, kFs, 40);
  for (std::size_t l = 0; l < frame.line_count; ++l)
    for (std::size_t k = 300; k < 500; ++k) {
      const std::size_t n = k + frame.sample_count * l;
      frame.samples[n] = 30 * loud.samples[n];
    }
  EXPECT_NEAR(mean_frequency(frame, kFs) / kHz, 1, 0.1);
}

// Lines for samples and samples for lines.
RfFrame turned(const RfFrame& in) {
  RfFrame out{in.line_count, in.sample_count, std::vector<float>(in.samples.size())};
  for (std::size_t l = 0; l < in.line_count; ++l)
    for (std::size_t k = 0; k < in.sample_count; ++k)
      out.samples[l + in.line_count * k] = in.samples[k + in.sample_count * l];
  return out;
}

// Rectified, and the mean over about a period.
RfFrame envelope(const RfFrame& in) {
  constexpr std::size_t kPeriod = 6;
  RfFrame out = in;
  for (std::size_t n = kPeriod; n < in.samples.size(); ++n) {
    out.samples[n] = 0;
    for (std::size_t k = 0; k < kPeriod; ++k) out.samples[n] += std::abs(in.samples[n - k]);
  }
  return out;
}

TEST(InputChecks, WhatIsNoRfOrStandsAcrossIsNamed) {
  const auto named = [](const RfFrame& frame) {
    const std::optional<Warning> said = contradicted_rf(frame);
    return std::string(said ? name_of(said->flag) : "");
  };
  for (const double fs_hz : {40e6, 100e6})
    for (const double center_hz : {2.5e6, 5e6, 10e6})
      for (const double snr_db : {0.0, 40.0})
        EXPECT_EQ(named(band(center_hz, fs_hz, snr_db)), "") << center_hz << " of " << fs_hz;
  for (const double snr_db : {0.0, 30.0}) {
    const RfFrame rf = tissue(snr_db).frame([](double, double) { return std::pair{0.0, 0.0}; }, 1);
    EXPECT_EQ(named(rf), "");
    EXPECT_EQ(named(turned(rf)), "axis");
    EXPECT_EQ(named(envelope(rf)), "image");
  }
  EXPECT_EQ(named({64, 16, std::vector<float>(1024, 3.f)}), "");
}

TEST(InputChecks, TheFrameThatRestsWhereItSaysIsNotDoubted) {
  AcquisitionGeometry geometry = speckle_geometry();
  geometry.frame = DisplacementFrame::kProbe;
  EXPECT_EQ(warnings(0, geometry), std::vector<std::string>{});
  geometry.frame = DisplacementFrame::kLab;
  EXPECT_EQ(warnings(kDepthM, geometry), std::vector<std::string>{});
  EXPECT_EQ(warnings(2 * kDepthM, geometry), std::vector<std::string>{})
      << "the frame ends above the far side";
}

TEST(InputChecks, TheOtherFrameIsNamed) {
  AcquisitionGeometry geometry = speckle_geometry();
  geometry.frame = DisplacementFrame::kLab;
  auto said = warnings(0, geometry);
  ASSERT_EQ(said.size(), 1u);
  EXPECT_EQ(said[0].rfind("displacement_frame: LAB is stated", 0), 0u) << said[0];
  geometry.frame = DisplacementFrame::kProbe;
  said = warnings(kDepthM, geometry);
  ASSERT_EQ(said.size(), 1u);
  EXPECT_EQ(said[0].rfind("displacement_frame: PROBE is stated", 0), 0u) << said[0];
}

TEST(InputChecks, ACentreFrequencyThatTheEchoesDoNotHaveIsNamed) {
  AcquisitionGeometry geometry = speckle_geometry();
  geometry.center_frequency_hz = 3.5e6;
  const auto said = warnings(0, geometry);
  ASSERT_EQ(said.size(), 1u);
  EXPECT_EQ(said[0].rfind("center_frequency_hz: 3.5 MHz is stated", 0), 0u) << said[0];
}

// Wherever they are refused: too few samples of depth are left to be tracked, or they have no strain.
TEST(InputChecks, ARefusedPairThatLiesAcrossNamesItsAxis) {
  Elastography elastography(imaging_device());
  AcquisitionGeometry geometry = speckle_geometry();
  const Speckle speckle = tissue(30);
  const auto frame = [&](double strain) {
    return turned(speckle.frame([=](double, double y) { return std::pair{0.0, strain * y}; }, 1));
  };
  const RfFrame pre = frame(0), post = frame(kStrain);
  const TissueExtent extent{static_cast<double>(pre.line_count) * geometry.line_pitch_m, kDepthM, 0, 0.0};
  try {
    elastography.estimate(pre, post, {geometry, std::nullopt, extent});
    FAIL() << "lines were tracked as samples";
  } catch (const std::exception& refusal) {
    EXPECT_NE(std::string(refusal.what()).find("axis: the samples do not oscillate"), std::string::npos)
        << refusal.what();
  }
}

// What may be the reason stands in the refusal.
TEST(InputChecks, ARefusedPairNamesTheFrequencyToo) {
  Elastography elastography(imaging_device());
  AcquisitionGeometry geometry = speckle_geometry();
  geometry.center_frequency_hz = 3.5e6;
  const auto still = [](double, double) { return std::pair{0.0, 0.0}; };
  SpeckleOptions other;
  other.samples = kSamples;
  other.lines = kLines;
  other.seed = 99;
  try {
    elastography.estimate(
        tissue(30).frame(still, 1), Speckle(other).frame(still, 2),
        {geometry, std::nullopt, {static_cast<double>(kLines) * geometry.line_pitch_m, kDepthM, 0, 0.0}});
    FAIL() << "unrelated frames were tracked";
  } catch (const TrackingError& refusal) {
    EXPECT_NE(std::string(refusal.what()).find("center_frequency_hz: 3.5 MHz"), std::string::npos)
        << refusal.what();
  }
}

}  // namespace
}  // namespace teletact::service
