#include "service/imaging/tracking/b_mode.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "service/device/cancellation.h"
#include "service/imaging/tracking/sample_grid.h"

namespace teletact::service {
namespace {

// Power over the largest, in dB, as grey.
std::vector<std::uint8_t> compressed(const std::vector<float>& power) {
  const float most = *std::max_element(power.begin(), power.end());
  std::vector<std::uint8_t> grey(power.size(), 0);
  if (!(most > 0)) return grey;  // silence
  const float scale = static_cast<float>(255 * 10 / BMode::kRangeDb);
  for (std::size_t n = 0; n < power.size(); ++n)
    grey[n] = static_cast<std::uint8_t>(
        std::lround(std::clamp(255 + scale * std::log10(std::max(power[n] / most, 1e-30F)), 0.0F, 255.0F)));
  return grey;
}

// By what the largest sample is about one: powers of any frame are numbers then.
float to_one(const RfFrame& frame) {
  float most = 0;
  for (const float sample : frame.samples) most = std::max(most, std::abs(sample));
  return std::clamp(1 / most, std::numeric_limits<float>::min(), std::numeric_limits<float>::max());
}

}  // namespace

QuadratureTaps quadrature_taps(const AcquisitionGeometry& geometry) {
  constexpr double kPeriods = 2, kMaxPerPeriod = 16;
  const double period = geometry.sampling_frequency_hz / geometry.center_frequency_hz;  // in samples
  QuadratureTaps out;
  out.step = std::max(1, static_cast<int>(period / kMaxPerPeriod));
  out.half = static_cast<int>(std::ceil(kPeriods / 2 * period / out.step)) - 1;
  for (int t = -out.half; t <= out.half; ++t) {
    const double at = 2 * std::numbers::pi * t * out.step / period, window = 1 + std::cos(at / kPeriods);
    out.taps.push_back(
        {static_cast<float>(window * std::cos(at)), static_cast<float>(window * std::sin(at))});
  }
  return out;
}

BModeImager::BModeImager(Queue queue)
    : queue_(std::move(queue)),
      power_(queue_.kernel("b_mode", "envelope_power", Precision::kFloat)),
      rows_(queue_.kernel("b_mode", "mean_rows", Precision::kFloat)) {}

BMode BModeImager::image(const RfFrame& frame, const AcquisitionGeometry& geometry) {
  const QuadratureTaps quadrature = quadrature_taps(geometry);
  const std::size_t samples = frame.sample_count, lines = frame.line_count;
  const std::size_t step = (samples + BMode::kMaxRows - 1) / BMode::kMaxRows,
                    rows = (samples + step - 1) / step;
  const Padding pad = padding(frame, quadrature.half * quadrature.step, 0);
  const Array<float> image = queue_.array(padded(frame, pad));
  const Array<float> power = queue_.array<float>(samples * lines), means = queue_.array<float>(lines * rows);
  const float scale = to_one(frame);
  std::vector<float> taps;
  for (const auto& [cosine, sine] : quadrature.taps) taps.insert(taps.end(), {scale * cosine, scale * sine});
  power_({{samples, lines, 1}, {kGroup, 1, 1}}, image, queue_.array(taps), power, pad.layout,
         static_cast<int>(samples), static_cast<int>(lines), quadrature.half, quadrature.step);
  rows_({{lines, rows, 1}, {kGroup, 1, 1}}, power, means, static_cast<int>(samples), static_cast<int>(lines),
        static_cast<int>(rows), static_cast<int>(step));
  const double pitch_m = geometry.sample_pitch_m(), height_m = static_cast<double>(step) * pitch_m;
  BMode out{{lines, rows, geometry.line_pitch_m / 2, geometry.first_sample_depth_m + (height_m - pitch_m) / 2,
             geometry.line_pitch_m, height_m},
            compressed(queue_.read(means))};
  check_cancelled();
  return out;
}

}  // namespace teletact::service
