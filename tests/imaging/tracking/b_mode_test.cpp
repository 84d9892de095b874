// B-mode images: the kernels against sums in double, and those against an analytic signal's envelope.
#include "service/imaging/tracking/b_mode.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <random>

#include "tests/imaging/imaging_device.h"
#include "tests/reference/b_mode.h"

namespace teletact::service {
namespace {

AcquisitionGeometry geometry_of(double center_hz, double sampling_hz) {
  AcquisitionGeometry g;
  g.center_frequency_hz = center_hz;
  g.sampling_frequency_hz = sampling_hz;
  g.line_pitch_m = 0.3e-3;
  g.first_sample_depth_m = 2e-3;
  return g;
}

// Echoes of random scatterers: packets of the centre frequency with 60 % bandwidth.
RfFrame speckle(std::size_t samples, std::size_t lines, double period) {
  RfFrame frame{samples, lines, std::vector<float>(samples * lines, 0.0F)};
  std::mt19937 random(3);
  std::normal_distribution<double> strength;
  std::uniform_real_distribution<double> place(0, static_cast<double>(samples));
  for (std::size_t l = 0; l < lines; ++l)
    for (std::size_t s = 0; s < samples / 3; ++s) {
      const double at = place(random), a = strength(random);
      const double width = 0.62 * period;  // -6 dB at 0.3 of the centre frequency to both sides
      for (std::size_t k = 0; k < samples; ++k) {
        const double away = static_cast<double>(k) - at;
        if (std::abs(away) > 5 * width) continue;
        frame.samples[k + samples * l] +=
            static_cast<float>(a * std::exp(-away * away / (2 * width * width)) *
                               std::cos(2 * std::numbers::pi * away / period));
      }
    }
  return frame;
}

std::vector<double> doubles(const RfFrame& frame) {
  return {frame.samples.begin(), frame.samples.end()};
}

TEST(BMode, MatchesReference) {
  BModeImager imager(imaging_device()->queue());
  struct Case {
    std::size_t samples, lines;
    double center_hz, sampling_hz;
  };
  // Rows that are no multiple of the work group; several samples to a row; few and many samples to a period.
  for (const Case c : {Case{129, 9, 7.3e6, 40e6}, Case{1100, 33, 5e6, 100e6}, Case{300, 8, 5e6, 10.5e6},
                       Case{513, 8, 1e6, 100e6}}) {
    const AcquisitionGeometry g = geometry_of(c.center_hz, c.sampling_hz);
    const double period = c.sampling_hz / c.center_hz;
    const RfFrame frame = speckle(c.samples, c.lines, period);
    const BMode got = imager.image(frame, g);
    const int step = static_cast<int>((c.samples + 511) / 512);
    const auto want =
        reference::b_mode(doubles(frame), static_cast<int>(c.samples), static_cast<int>(c.lines), period,
                          std::max(1, static_cast<int>(period / 16)), step);
    ASSERT_EQ(got.grey.size(), want.size());
    ASSERT_EQ(got.grid.size(), want.size());
    for (std::size_t n = 0; n < want.size(); ++n)
      ASSERT_LE(std::abs(int(got.grey[n]) - int(want[n])), want[n] > 60 ? 1 : 6)
          << n;  // near -60 dB rounding shows
    EXPECT_EQ(*std::max_element(got.grey.begin(), got.grey.end()), 255);
    EXPECT_LE(got.grid.ny, BMode::kMaxRows);
    EXPECT_DOUBLE_EQ(got.grid.origin_x_m, g.line_pitch_m / 2);
    EXPECT_DOUBLE_EQ(got.grid.origin_y_m, g.first_sample_depth_m + (step - 1) * g.sample_pitch_m() / 2);
    EXPECT_DOUBLE_EQ(got.grid.dy_m, step * g.sample_pitch_m());
  }
}

// The envelope of the analytic signal, which the packet's filter smooths a little: most of the image within
// 1.5 dB where it is brighter than -20 dB.
TEST(BMode, IsTheEnvelopeOfTheAnalyticSignal) {
  BModeImager imager(imaging_device()->queue());
  const double period = 40.0 / 7.3;
  const RfFrame frame = speckle(400, 8, period);
  const BMode got = imager.image(frame, geometry_of(7.3e6, 40e6));
  std::vector<double> envelope;
  for (std::size_t l = 0; l < 8; ++l) {
    const auto line = doubles(frame);
    const auto begin = line.begin() + static_cast<std::ptrdiff_t>(400 * l);
    const auto of_line = reference::hilbert_envelope({begin, begin + 400});
    envelope.insert(envelope.end(), of_line.begin(), of_line.end());
  }
  std::vector<double> off_db;  // as log-compressed, up to one factor for the whole image
  for (std::size_t k = 20; k < 380; ++k)
    for (std::size_t l = 0; l < 8; ++l) {
      const double db = 60.0 * (got.grey[l + 8 * k] / 255.0 - 1);
      if (db > -20) off_db.push_back(db - 20 * std::log10(envelope[k + 400 * l]));
    }
  ASSERT_GT(off_db.size(), 1000u);
  std::ranges::sort(off_db);
  const double median = off_db[off_db.size() / 2];
  std::size_t near = 0;
  for (const double off : off_db) near += std::abs(off - median) < 1.5;
  EXPECT_GT(static_cast<double>(near), 0.8 * static_cast<double>(off_db.size()));
}

TEST(BMode, SilenceAndHugeEchoesAreImages) {
  BModeImager imager(imaging_device()->queue());
  RfFrame frame{64, 8, std::vector<float>(64 * 8, 0.0F)};
  const AcquisitionGeometry g = geometry_of(7.3e6, 40e6);
  const BMode silent = imager.image(frame, g);
  EXPECT_EQ(std::ranges::count(silent.grey, 0), 64 * 8);
  for (const float echo : {3e38F, -1e-37F}) {  // beyond what the square of a float holds
    frame.samples[64 * 3 + 30] = echo;
    const std::vector<std::uint8_t> grey = imager.image(frame, g).grey;
    EXPECT_EQ(grey[3 + 8 * 30], 255);
    EXPECT_EQ(grey[2 + 8 * 30] + grey[4 + 8 * 30], 0) << "the lines beside it are silent";
  }
}

}  // namespace
}  // namespace teletact::service
