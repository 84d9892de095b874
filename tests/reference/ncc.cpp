#include "tests/reference/ncc.h"

#include <cmath>
#include <numbers>

namespace teletact::reference {
namespace {

double kaiser_sinc(double distance) {
  constexpr double kBeta = 5, kHalfWidth = 4;
  const double inside = 1 - distance * distance / (kHalfWidth * kHalfWidth);
  if (inside <= 0) return 0;
  const double angle = std::numbers::pi * distance;
  const double sinc = angle == 0 ? 1 : std::sin(angle) / angle;
  return sinc * std::cyl_bessel_i(0.0, kBeta * std::sqrt(inside)) / std::cyl_bessel_i(0.0, kBeta);
}

}  // namespace

double normalised_cross_correlation(const RfImage& pre, const RfImage& post, int sample, int line,
                                    const Window& window, int axial_lag, int lateral_lag) {
  double aa = 0, bb = 0, ab = 0;
  int outermost = window.half_lateral;
  while (2 * outermost % window.line_stride != 0) --outermost;
  for (int l = -outermost; l <= outermost; l += window.line_stride)
    for (int k = -window.half_axial; k <= window.half_axial; k += window.stride) {
      const double a = pre.at(sample + k, line + l);
      const double b = post.at(sample + k + axial_lag, line + l + lateral_lag);
      aa += a * a;
      bb += b * b;
      ab += a * b;
    }
  return aa > 0 && bb > 0 ? ab / std::sqrt(aa * bb) : 0;
}

Shift ncc_peak(const RfImage& pre, const RfImage& post, int sample, int line, const Window& window,
               const std::array<int, 2>& axial, const std::array<int, 2>& lateral) {
  const auto correlation = [&](int k, int l) {
    return normalised_cross_correlation(pre, post, sample, line, window, k, l);
  };
  int best_k = axial[0], best_l = lateral[0];
  double best = -2;
  for (int l = lateral[0]; l <= lateral[1]; ++l)
    for (int k = axial[0]; k <= axial[1]; ++k)
      if (const double c = correlation(k, l); c > best) best = c, best_k = k, best_l = l;
  const auto fraction = [&](double before, double after) {
    const double curvature = before - 2 * best + after;
    return curvature < 0 ? 0.5 * (before - after) / curvature : 0;
  };
  return {best_l + fraction(correlation(best_k, best_l - 1), correlation(best_k, best_l + 1)),
          best_k + fraction(correlation(best_k - 1, best_l), correlation(best_k + 1, best_l))};
}

double interpolate(const RfImage& post, int sample, int line, const Shift& u) {
  const double y = sample + u.samples, x = line + u.lines;
  const int k0 = static_cast<int>(std::floor(y)), l0 = static_cast<int>(std::floor(x));
  if (k0 < 0 || k0 >= post.samples || l0 < 0 || l0 >= post.lines) return 0;
  double value = 0, sum = 0;
  for (int k = k0 - 3; k <= k0 + 4; ++k)
    for (int l = l0 - 3; l <= l0 + 4; ++l) {
      const double tap = kaiser_sinc(k - y) * kaiser_sinc(l - x);
      sum += tap;
      value += tap * post.at(k, l);
    }
  return value / sum;
}

}  // namespace teletact::reference
