#include "bench/stability/rest.h"

#include <algorithm>
#include <cmath>

namespace teletact::bench {
namespace {

// A window is whole sampling periods, long enough for the slowest swing: of a hand by itself, and of a force
// that is late, four times as long as it is late.
double window_of(const RestOptions& o) {
  constexpr double kHandS = 0.5, kSwings = 4;
  const double min_s = std::max(kHandS, kSwings * (o.update_s + o.delay_s));
  return o.update_s * std::ceil(min_s / o.update_s);
}

double length_of(const RestOptions& o) {
  constexpr double kCycles = 40;
  return std::max({o.min_s, kCycles * (o.update_s + o.delay_s), 3 * window_of(o)});
}

}  // namespace

const char* to_string(Verdict verdict) {
  switch (verdict) {
    case Verdict::kStable:
      return "stable";
    case Verdict::kLimitCycle:
      return "limit cycle";
    case Verdict::kUnstable:
      return "unstable";
  }
  return "unknown";
}

RestWatch::RestWatch(const RestOptions& options)
    : unfelt_m_(options.unfelt_m),
      window_s_(window_of(options)),
      length_s_(length_of(options)),
      now_end_s_(window_s_) {}

void RestWatch::add(const Eigen::Vector3d& position_m, double time_s) noexcept {
  constexpr double kStillM = 1e-7;
  if (time_s >= now_end_s_) {
    settled_ = settled_ || now_.peak_to_peak_m() < kStillM;
    now_ = {};
    now_end_s_ += window_s_;
  }
  now_.add(position_m);
  const double half_s = length_s_ / 2;
  if (time_s >= half_s - window_s_ && time_s < half_s) half_.add(position_m);
  if (time_s >= length_s_ - window_s_) last_.add(position_m);
}

double RestWatch::swing_m() const noexcept {
  return settled_ ? 0 : last_.peak_to_peak_m();
}

Verdict RestWatch::verdict() const noexcept {
  constexpr double kUnstableM = 0.004;  // a swing that a hand would not hold
  constexpr double kDecayed = 0.8;
  const double swing = swing_m();
  if (swing < unfelt_m_ || swing < kDecayed * half_.peak_to_peak_m()) return Verdict::kStable;
  return swing < kUnstableM ? Verdict::kLimitCycle : Verdict::kUnstable;
}

}  // namespace teletact::bench
