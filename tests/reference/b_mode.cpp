#include "tests/reference/b_mode.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstddef>
#include <numbers>

namespace teletact::reference {
namespace {

constexpr double kPi = std::numbers::pi;

double power_at(const std::vector<double>& rf, int samples, int l, int k, double period, int step) {
  std::complex<double> sum = 0;
  for (int offset = -step * static_cast<int>(period / step); std::abs(offset) < 2 * period; offset += step) {
    if (!(std::abs(offset) < period) || k + offset < 0 || k + offset >= samples) continue;
    const double hann = 1 + std::cos(kPi * offset / period);
    sum += hann *
           rf[static_cast<std::size_t>(l) * static_cast<std::size_t>(samples) +
              static_cast<std::size_t>(k + offset)] *
           std::polar(1.0, 2 * kPi * offset / period);
  }
  return std::norm(sum);
}

}  // namespace

std::vector<std::uint8_t> b_mode(const std::vector<double>& rf, int samples, int lines, double period_samples,
                                 int tap_step, int rows_step) {
  std::vector<double> mean;
  for (int begin = 0; begin < samples; begin += rows_step)
    for (int l = 0; l < lines; ++l) {
      const int end = std::min(begin + rows_step, samples);
      double sum = 0;
      for (int k = begin; k < end; ++k) sum += power_at(rf, samples, l, k, period_samples, tap_step);
      mean.push_back(sum / (end - begin));
    }
  const double most = *std::max_element(mean.begin(), mean.end());
  std::vector<std::uint8_t> grey;
  for (const double power : mean) {
    const double db = power > 0 ? 10 * std::log10(power / most) : -HUGE_VAL;
    grey.push_back(static_cast<std::uint8_t>(std::lround(255 * std::clamp(1 + db / 60, 0.0, 1.0))));
  }
  return grey;
}

std::vector<double> hilbert_envelope(const std::vector<double>& line) {
  const std::size_t n = line.size();
  std::vector<std::complex<double>> analytic(n, 0.0);
  for (std::size_t f = 0; f <= n / 2; ++f) {
    const double step = 2 * kPi * static_cast<double>(f) / static_cast<double>(n);
    std::complex<double> spectrum = 0;
    for (std::size_t k = 0; k < n; ++k) spectrum += line[k] * std::polar(1.0, -step * static_cast<double>(k));
    const double twice = f == 0 || 2 * f == n ? 1 : 2;
    for (std::size_t k = 0; k < n; ++k)
      analytic[k] +=
          twice / static_cast<double>(n) * spectrum * std::polar(1.0, step * static_cast<double>(k));
  }
  std::vector<double> out;
  for (const auto& value : analytic) out.push_back(std::abs(value));
  return out;
}

}  // namespace teletact::reference
