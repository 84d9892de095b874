#include "client/render/force_limits.h"

#include <algorithm>
#include <cmath>

namespace teletact::client {
namespace {

// 1 up to `full`, linear to 0 at `none`; NaN gives 0.
double falling(double value, double full, double none) noexcept {
  if (value <= full) return 1;
  if (value < none) return (none - value) / (none - full);
  return 0;
}

}  // namespace

SilenceLimits silence_limits(double expected_period_s, bool by_law) noexcept {
  constexpr double kShortestFadeS = 0.05;
  constexpr double kLongestZeroS = 0.5;
  // Silence is counted from an answer that left a little before the link broke, and the force is written on
  // the tick after: zero comes this much before the limit, so that it holds however it is counted.
  constexpr double kMarginS = 0.008;
  static_assert(kLawSilence.zero_s <= kLongestZeroS - kMarginS);
  if (by_law) return kLawSilence;
  SilenceLimits limits;
  const double period_s = std::isfinite(expected_period_s) ? expected_period_s : 0;
  limits.fade_s = std::clamp(2 * period_s, kShortestFadeS, kLongestZeroS / 2);
  limits.zero_s = std::min(3 * limits.fade_s, kLongestZeroS) - kMarginS;
  return limits;
}

double silence_gain(double silence_s, const SilenceLimits& limits) noexcept {
  return falling(silence_s, limits.fade_s, limits.zero_s);
}

AgeLimits age_limits(double expected_period_s) noexcept {
  constexpr double kLateS = 0.2, kMarginS = 0.01, kLongestS = 0.4;
  AgeLimits limits;
  const double period_s = std::isfinite(expected_period_s) ? expected_period_s : 0;
  limits.degraded_s = std::clamp(kLateS + period_s + kMarginS, limits.degraded_s, kLongestS);
  return limits;
}

double age_gain(double model_age_s, const AgeLimits& limits) noexcept {
  return falling(model_age_s, limits.degraded_s, limits.zero_s);
}

double start_gain(double enabled_s, double ramp_s) noexcept {
  if (!(enabled_s > 0)) return 0;  // NaN too
  return std::min(enabled_s / ramp_s, 1.0);
}

Vector3 cap_stiffness(const Vector3& force_n, double indentation_m, double stiffness_n_m) noexcept {
  return cap_magnitude(force_n, stiffness_n_m * std::max(indentation_m, 0.0));
}

Vector3 cap_magnitude(const Vector3& force_n, double largest_n) noexcept {
  // stableNorm: the square of a hostile but finite force may overflow.
  const double magnitude_n = force_n.stableNorm();
  return magnitude_n > largest_n ? Vector3(force_n / magnitude_n * largest_n) : force_n;
}

Vector3 cap_rise(const Vector3& force_n, const Vector3& previous_n, double rise_n) noexcept {
  const Vector3 way_n = force_n - previous_n;
  // Where on the way the magnitude is least; NaN when there is no way to go.
  const double least = -previous_n.dot(way_n) / way_n.squaredNorm();
  if (!(least < 1)) return force_n;
  const Vector3 fallen_n = previous_n + std::max(least, 0.0) * way_n;
  return fallen_n + cap_magnitude(force_n - fallen_n, rise_n);
}

Vector3 cap_slew(const Vector3& force_n, const Vector3& previous_n, double slew_n_s, double dt_s) noexcept {
  return previous_n + cap_magnitude(force_n - previous_n, slew_n_s * dt_s);
}

}  // namespace teletact::client
