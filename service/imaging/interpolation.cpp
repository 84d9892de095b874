#include "service/imaging/interpolation.h"

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

}  // namespace teletact::service
