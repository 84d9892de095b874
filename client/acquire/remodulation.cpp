#include "client/acquire/remodulation.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

#include "client/acquire/recorded_frames.h"

namespace teletact::client {
namespace {

using Complex = std::complex<double>;

constexpr double kSamplesInPeriod =
    5;                              // at least, of the centre frequency: with 4, tracking is 1.4 times off
constexpr double kMinRate = 0.5;  // of complex data, over the centre frequency: no pulse has less of a band
constexpr double kMinLikeness = 0.5;  // of neighbours in depth: with less, 1 % of the band is folded over
constexpr double kSame = 0.01;          // of two frequencies that are said to be one

// The window's half width in samples, and its shape: the stop band is 80 dB down.
constexpr int kHalf = 16;
constexpr double kShape = 8;

double sinc(double t) {
  return t == 0 ? 1 : std::sin(std::numbers::pi * t) / (std::numbers::pi * t);
}

// weights[phase][tap] of sample floor + tap - kHalf + 1, for a place phase / factor behind floor.
std::vector<std::vector<double>> weights(std::size_t factor) {
  std::vector<std::vector<double>> out(factor);
  for (std::size_t phase = 0; phase < factor; ++phase)
    for (int tap = 0; tap < 2 * kHalf; ++tap) {
      const double t = tap - kHalf + 1 - static_cast<double>(phase) / static_cast<double>(factor);
      const double edge = std::max(0.0, 1 - t * t / (kHalf * kHalf));
      out[phase].push_back(sinc(t) * std::cyl_bessel_i(0, kShape * std::sqrt(edge)) /
                           std::cyl_bessel_i(0, kShape));
    }
  return out;
}

double energy(const std::vector<float>& values) {
  double sum = 0;
  for (const float v : values) sum += double{v} * v;
  return sum;
}

// recorded_frames judges whether they are RF.
RfImage real_rf(const UffImage& image, const PulseOptions& pulse) {
  RfImage out;
  out.sample_count = image.sample_count;
  out.sampling_frequency_hz = pulse.sound_speed_m_s / (2 * image.sample_pitch_m);
  out.samples = image.values;
  return out;
}

double modulation_of(const UffImage& image, const PulseOptions& pulse, const std::string& file) {
  if (!image.modulation_frequency_hz && !pulse.modulation_frequency_hz)
    throw FrameInputError(
        file +
        ": does not state the modulation_frequency of its complex data; give --modulation-frequency-hz, that "
        "of the channel data it was made of (0 where they were RF)");
  if (image.modulation_frequency_hz && pulse.modulation_frequency_hz &&
      !(std::abs(*pulse.modulation_frequency_hz - *image.modulation_frequency_hz) <=
        kSame * *image.modulation_frequency_hz))
    throw FrameInputError(
        fmt::format("--modulation-frequency-hz {:.6g} contradicts {}, which states {:.6g} Hz; leave it out, "
                    "or correct the file",
                    *pulse.modulation_frequency_hz, file, *image.modulation_frequency_hz));
  return image.modulation_frequency_hz ? *image.modulation_frequency_hz : *pulse.modulation_frequency_hz;
}

// exp(2 pi i f 2 z / c) of n depths, `step` apart.
std::vector<Complex> carrier(double frequency_hz, double sound_speed_m_s, double first_m, double step_m,
                             std::size_t n) {
  std::vector<Complex> out(n);
  for (std::size_t k = 0; k < n; ++k)
    out[k] = std::polar(1.0, 4 * std::numbers::pi * frequency_hz / sound_speed_m_s *
                                 (first_m + step_m * static_cast<double>(k)));
  return out;
}

// The mean of conj(b[k]) b[k + 1] over that of |b|^2: 1 of a constant, 0 of white noise; its angle is the
// middle of the spectrum.
Complex likeness_of_neighbours(const std::vector<Complex>& lines, std::size_t sample_count) {
  Complex next{};
  double same = 0;
  for (std::size_t k = 0; k < lines.size(); ++k) {
    if (k % sample_count == 0) continue;
    next += std::conj(lines[k - 1]) * lines[k];
    same += (std::norm(lines[k - 1]) + std::norm(lines[k])) / 2;
  }
  return same > 0 ? next / same : 1.0;
}

}  // namespace

RfImage rf_of(const UffImage& image, const PulseOptions& pulse, const std::string& file) {
  if (energy(image.imaginary) == 0) return real_rf(image, pulse);
  const double f0 = pulse.center_frequency_hz, c = pulse.sound_speed_m_s,
               f_m = modulation_of(image, pulse, file);
  const double rate = c / (2 * image.sample_pitch_m);
  const auto refuse_step = [&] {
    throw FrameInputError(fmt::format(
        "{}: z_axis: places {:.3g} m apart are too few for the band of the pulse; beamform at most {:.3g} m "
        "apart",
        file, image.sample_pitch_m, c / (4 * f0)));
  };
  if (!(rate >= kMinRate * f0)) refuse_step();
  const std::size_t n = image.sample_count;
  const auto factor = static_cast<std::size_t>(std::ceil(std::max(1.0, kSamplesInPeriod * f0 / rate)));
  std::vector<Complex> lines(image.values.size());
  const auto to_zero = carrier(f_m - f0, c, image.first_sample_depth_m, image.sample_pitch_m, n);
  for (std::size_t k = 0; k < lines.size(); ++k)
    lines[k] = Complex(image.values[k], image.imaginary[k]) * to_zero[k % n];
  const Complex likeness = likeness_of_neighbours(lines, n);
  if (std::abs(likeness) < kMinLikeness) refuse_step();
  const double off_hz = std::arg(likeness) / (2 * std::numbers::pi) * rate;
  if (std::abs(off_hz) > std::min(rate / 4, f0 / 2))
    throw FrameInputError(
        fmt::format("{}: its echoes lie at {:.3g} Hz, not at {:.3g}; correct --center-frequency-hz, or the "
                    "modulation frequency",
                    file, f0 + off_hz, f0));
  RfImage out;
  out.sample_count = (n - 1) * factor + 1;
  out.sampling_frequency_hz = rate * static_cast<double>(factor);
  out.samples.resize(out.sample_count * image.line_count);
  const auto back = carrier(f0, c, image.first_sample_depth_m,
                            image.sample_pitch_m / static_cast<double>(factor), out.sample_count);
  const auto taps = weights(factor);
  for (std::size_t l = 0; l < image.line_count; ++l)
    for (std::size_t k = 0; k < out.sample_count; ++k) {
      const auto at = static_cast<std::ptrdiff_t>(k / factor), last = static_cast<std::ptrdiff_t>(n) - 1;
      const auto& tap = taps[k % factor];
      const Complex* line = lines.data() + n * l;
      const std::ptrdiff_t begin = std::max<std::ptrdiff_t>(0, at - kHalf + 1),
                           end = std::min(last, at + kHalf);
      Complex sum{};
      for (std::ptrdiff_t s = begin; s <= end; ++s)
        sum += line[s] * tap[static_cast<std::size_t>(s - at + kHalf - 1)];
      out.samples[k + out.sample_count * l] = static_cast<float>((sum * back[k]).real());
    }
  out.made =
      fmt::format("RF of {}: complex data of {:.4g} MHz at {:.4g} MHz, {} samples for each: {:.4g} MHz", file,
                  f_m * 1e-6, rate * 1e-6, factor, out.sampling_frequency_hz * 1e-6);
  return out;
}

}  // namespace teletact::client
