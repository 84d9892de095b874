#include "service/imaging/tracking/interpolation.h"

#include <cmath>
#include <cstddef>
#include <numbers>

namespace teletact::service {
namespace {

constexpr double kKaiserBeta = 5.0;

double windowed_sinc(double distance) {
  const double inside = 1 - std::pow(distance / (kInterpolationTaps / 2.0), 2);
  if (inside <= 0) return 0;
  const double window =
      std::cyl_bessel_i(0, kKaiserBeta * std::sqrt(inside)) / std::cyl_bessel_i(0, kKaiserBeta);
  const double angle = std::numbers::pi * distance;
  return std::abs(distance) < 1e-12 ? window : window * std::sin(angle) / angle;
}

// Coefficient of T_order of a function on [-1, 1].
template <class Function>
double chebyshev(int order, const Function& f) {
  constexpr int kNodes = 64;
  double sum = 0;
  for (int n = 0; n < kNodes; ++n) {
    const double angle = std::numbers::pi * (n + 0.5) / kNodes;
    sum += std::cos(order * angle) * f(std::cos(angle));
  }
  return (order == 0 ? 1.0 : 2.0) / kNodes * sum;
}

}  // namespace

std::vector<float> interpolation_taps() {
  std::vector<float> taps;
  for (int phase = 0; phase <= kInterpolationPhases; ++phase) {
    const double fraction = static_cast<double>(phase) / kInterpolationPhases;
    double row[kInterpolationTaps], sum = 0;
    for (int n = 0; n < kInterpolationTaps; ++n) sum += row[n] = windowed_sinc(n - 3 - fraction);
    for (const double tap : row) taps.push_back(static_cast<float>(tap / sum));
  }
  return taps;
}

std::vector<float> interpolation_series() {
  constexpr double kRange = kInterpolationRange;
  std::vector<float> series(std::size_t{4} * kInterpolationOrders);
  for (int n = 0; n < 4; ++n)
    for (int order = 0; order < kInterpolationOrders; ++order)
      series[4 * static_cast<std::size_t>(order) + static_cast<std::size_t>(n)] =
          static_cast<float>(chebyshev(order, [&](double t) { return windowed_sinc(kRange * t - n); }));
  const auto gain = [](double distance) {
    double sum = 0;
    for (int n = -3; n <= 4; ++n) sum += windowed_sinc(distance - n);
    return 1 / sum;
  };
  for (int order = 0; order < kInterpolationFarOrders; ++order)
    series.push_back(static_cast<float>(
        chebyshev(order, [&](double s) { return windowed_sinc(kRange * (s + 1) / 2 - 4); })));
  for (int order = 0; order < kInterpolationFarOrders; ++order)
    series.push_back(
        static_cast<float>(chebyshev(order, [&](double s) { return gain(kRange * (s + 1) / 2); })));
  return series;
}

}  // namespace teletact::service
