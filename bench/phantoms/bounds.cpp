#include "bench/phantoms/bounds.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace teletact::bench {
namespace {

constexpr double kPi = std::numbers::pi;

// Echo power spectrum over its peak; |spectrum| falls to one half at f0 (1 -+ B / 2).
double signal_power(const client::Ultrasound& u, double f_hz) {
  const double sigma = u.bandwidth * u.center_frequency_hz / (2 * std::sqrt(2 * std::numbers::ln2));
  return std::exp(-std::pow((f_hz - u.center_frequency_hz) / sigma, 2));
}

}  // namespace

double displacement_bound_m(const client::Ultrasound& u, double kernel_m) {
  const double low = std::max(0.0, u.center_frequency_hz * (1 - u.bandwidth));
  const double high = std::min(u.sampling_frequency_hz / 2, u.center_frequency_hz * (1 + u.bandwidth));
  constexpr int kSteps = 4000;
  const double df = (high - low) / kSteps;
  double signal = 0;
  for (int k = 0; k < kSteps; ++k) signal += signal_power(u, low + (k + .5) * df) * df;
  const double noise = signal / (high - low) * std::pow(10, -u.snr_db / 10);  // white in the band
  double information = 0;
  for (int k = 0; k < kSteps; ++k) {
    const double f = low + (k + .5) * df;
    const double g = u.correlation / (1 + noise / signal_power(u, f));
    information += std::pow(2 * kPi * f, 2) * g * g / (1 - g * g) * df;
  }
  const double duration_s = 2 * kernel_m / u.sound_speed_m_s;
  return u.sound_speed_m_s / 2 / std::sqrt(2 * duration_s * information);
}

double flat_displacement_bound_m(const client::Ultrasound& u, double kernel_m) {
  const double b = u.bandwidth, duration_s = 2 * kernel_m / u.sound_speed_m_s;
  const double noise = std::pow(10, -u.snr_db / 10);
  const double variance =
      3 / (2 * std::pow(u.center_frequency_hz, 3) * kPi * kPi * duration_s * (b * b * b + 12 * b)) *
      (std::pow((1 + noise) / u.correlation, 2) - 1);
  return u.sound_speed_m_s / 2 * std::sqrt(variance);
}

double independent_lines(const client::Ultrasound& u, double line_pitch_m, int lines) {
  const double sigma = u.wavelength_m() * u.f_number / (2 * std::sqrt(2 * std::numbers::ln2));
  double sum = 0;
  for (int a = 0; a < lines; ++a)
    for (int b = 0; b < lines; ++b) sum += std::exp(-std::pow((a - b) * line_pitch_m / sigma, 2) / 2);
  return lines * lines / sum;
}

double window_lines(const client::Ultrasound& u, double window_lateral_m, double line_pitch_m) {
  return independent_lines(u, line_pitch_m,
                           1 + 2 * static_cast<int>(std::lround(window_lateral_m / 2 / line_pitch_m)));
}

double strain_filter(const client::Ultrasound& u, double strain, double kernel_m, double slope_m,
                     double independent_kernels, bool companded) {
  client::Ultrasound within = u;
  if (!companded) {
    // Echoes at the ends of the kernel are off by strain * kernel / 2: the mean of the carrier's phase over
    // it.
    const double phase = 2 * kPi * u.center_frequency_hz / u.sound_speed_m_s * strain * kernel_m;
    const double coherence = phase < 1e-9 ? 1 : std::sin(std::min(phase, kPi)) / phase;
    within.correlation *= std::max(coherence, 1e-3);
  }
  const double sigma_u = displacement_bound_m(within, kernel_m) / std::sqrt(independent_kernels);
  // Least squares over n = slope / kernel independent displacements: var = 12 sigma^2 / (kernel^2 n (n^2 -
  // 1)), continued to n -> large; at least two kernels.
  const double n = std::max(2.0, slope_m / kernel_m);
  return strain / (sigma_u * std::sqrt(12 / (n * (n * n - 1))) / kernel_m);
}

}  // namespace teletact::bench
