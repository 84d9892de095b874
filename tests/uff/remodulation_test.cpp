// RF of complex data against the RF that they were made of.
#include "client/acquire/remodulation.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <functional>
#include <random>

#include "client/acquire/recorded_frames.h"
#include "tests/uff/recorded_image.h"

namespace teletact::client {
namespace {

constexpr double kSamplingHz = 40e6, kSoundSpeed = 1540, kCenterHz = 6e6, kFirstM = 0.0123;
constexpr std::size_t kSamples = 1601, kLines = 4;

// Speckle: echoes of a pulse of `kCenterHz` with a -6 dB band of 60 %.
std::vector<float> speckle() {
  constexpr double kPi = std::numbers::pi, kSpread = 0.3 * kCenterHz / 1.1774;  // Hz, of the amplitude
  std::mt19937 random(7);
  std::normal_distribution<double> strength;
  std::vector<float> rf(kSamples * kLines);
  for (std::size_t l = 0; l < kLines; ++l)
    for (std::size_t e = 0; e < kSamples; e += 2) {
      const double a = strength(random), at = static_cast<double>(e) + 0.3;
      for (std::size_t k = 0; k < kSamples; ++k) {
        const double t = (static_cast<double>(k) - at) / kSamplingHz;
        if (std::abs(t) > 2e-6) continue;
        rf[k + kSamples * l] += static_cast<float>(a * std::exp(-0.5 * std::pow(2 * kPi * kSpread * t, 2)) *
                                                   std::cos(2 * kPi * kCenterHz * t));
      }
    }
  return rf;
}

UffImage image_of(const ComplexLines& lines, std::size_t every) {
  UffImage image;
  image.sample_count = lines.samples, image.line_count = kLines;
  image.first_sample_depth_m = kFirstM, image.line_pitch_m = 3e-4;
  image.sample_pitch_m = static_cast<double>(every) * kSoundSpeed / (2 * kSamplingHz);
  image.values = lines.real, image.imaginary = lines.imaginary;
  return image;
}

ComplexLines iq(double shift_hz, std::size_t every, double up_hz = 0) {
  static const std::vector<float> rf = speckle();
  return demodulated(rf, kSamples, kSamplingHz, shift_hz, 5e6, every, 2 * kFirstM / kSoundSpeed, up_hz);
}

// Root mean square of the difference at the places that both have, over the RF's, away from the ends.
double difference(const RfImage& rf) {
  const std::vector<float> truth = speckle();
  double apart = 0, all = 0;
  const double step = kSamplingHz / rf.sampling_frequency_hz;
  for (std::size_t l = 0; l < kLines; ++l)
    for (std::size_t k = 0; k < rf.sample_count; ++k) {
      const double at = static_cast<double>(k) * step;
      const auto near = static_cast<std::size_t>(std::llround(at));
      if (std::abs(at - std::llround(at)) > 1e-6 || near < 200 || near + 200 > kSamples) continue;
      const double t = truth[near + kSamples * l];
      apart += std::pow(rf.samples[k + rf.sample_count * l] - t, 2), all += t * t;
    }
  return std::sqrt(apart / all);
}

std::string refusal(const UffImage& image, const PulseOptions& pulse) {
  try {
    rf_of(image, pulse, "a.uff");
  } catch (const FrameInputError& error) {
    EXPECT_EQ(std::string(error.what()).find("a.uff") == std::string::npos, false) << error.what();
    return error.what();
  }
  return "no error";
}

struct Recorded {
  const char* name;
  double shift_hz, up_hz;
  std::size_t every;
  double modulation_hz;
};

TEST(Remodulation, GivesTheRfThatTheComplexDataWereMadeOf) {
  for (const Recorded& r :
       {Recorded{"IQ at 10 MHz", 6e6, 0, 4, 6e6}, Recorded{"IQ of another frequency", 5.2e6, 0, 4, 5.2e6},
        Recorded{"IQ at 20 MHz", 6e6, 0, 2, 6e6}, Recorded{"IQ at 8 MHz", 6e6, 0, 5, 6e6},
        Recorded{"analytic at 40 MHz", 6e6, 6e6, 1, 0}, Recorded{"analytic at 10 MHz", 6e6, 6e6, 4, 0}}) {
    const UffImage image = image_of(iq(r.shift_hz, r.every, r.up_hz), r.every);
    const RfImage rf = rf_of(image, {kCenterHz, kSoundSpeed, r.modulation_hz}, "a.uff");
    EXPECT_GE(rf.sampling_frequency_hz, 5 * kCenterHz);
    EXPECT_EQ(rf.samples.size(), rf.sample_count * kLines);
    EXPECT_NE(rf.made.find("a.uff"), std::string::npos);
    std::printf("%s: %s; %.2f %% off\n", r.name, rf.made.c_str(), 100 * difference(rf));
    EXPECT_LT(difference(rf), 0.01) << r.name;
  }
}

TEST(Remodulation, TheFilesFrequencyIsTakenAndNotContradicted) {
  UffImage image = image_of(iq(6e6, 4), 4);
  EXPECT_NE(refusal(image, {kCenterHz, kSoundSpeed, {}}).find("--modulation-frequency-hz"),
            std::string::npos);
  image.modulation_frequency_hz = 6e6;
  EXPECT_LT(difference(rf_of(image, {kCenterHz, kSoundSpeed, {}}, "a.uff")), 0.01);
  EXPECT_NE(refusal(image, {kCenterHz, kSoundSpeed, 5e6}).find("contradicts a.uff, which states 6e+06 Hz"),
            std::string::npos);
}

TEST(Remodulation, RealRfIsTakenAsItIs) {
  UffImage image = image_of({kSamples, speckle(), {}}, 1);
  const RfImage rf = rf_of(image, {kCenterHz, kSoundSpeed, {}}, "a.uff");
  EXPECT_EQ(rf.samples, image.values);
  EXPECT_NEAR(rf.sampling_frequency_hz, kSamplingHz, 1);
  EXPECT_TRUE(rf.made.empty());
  image.imaginary.assign(image.values.size(), 0);
  EXPECT_EQ(rf_of(image, {kCenterHz, kSoundSpeed, {}}, "a.uff").samples, image.values);
}

// Never a silent wrong number: what was folded over at the sampling, or lies at another frequency, is said.
TEST(Remodulation, TooFewDepthsAndWrongFrequenciesAreRefused) {
  const std::string few = "too few for the band of the pulse; beamform at most";
  EXPECT_NE(refusal(image_of(iq(6e6, 8), 8), {kCenterHz, kSoundSpeed, 6e6}).find(few), std::string::npos);
  EXPECT_NE(refusal(image_of(iq(6e6, 16), 16), {kCenterHz, kSoundSpeed, 6e6}).find(few), std::string::npos);
  EXPECT_NE(refusal(image_of(iq(6e6, 2), 2), {kCenterHz, kSoundSpeed, 0}).find("its echoes lie at"),
            std::string::npos)
      << "IQ that is said to be analytic";
  EXPECT_NE(refusal(image_of(iq(6e6, 1, 6e6), 1), {kCenterHz, kSoundSpeed, 6e6}).find("its echoes lie at"),
            std::string::npos)
      << "analytic that is said to be IQ";
  EXPECT_EQ(
      refusal(image_of({401, std::vector<float>(401 * kLines), std::vector<float>(401 * kLines, 1e-30F)}, 4),
              {kCenterHz, kSoundSpeed, 6e6}),
      "no error")
      << "no echoes: the service says so";
}

}  // namespace
}  // namespace teletact::client
