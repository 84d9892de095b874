#include "bench/stability/path.h"
#include "bench/stability/servo_period.h"

#include <algorithm>
#include <cmath>

namespace teletact::bench {

HandPath::HandPath(const TrialOptions& options, double background_n_m)
    : hover_s_(kHoverS + options.model_delay_s), sweep_m_(options.sweep_m) {
  const double resisted = 1 + background_n_m / options.hand.stiffness_n_m;
  depth_m_ = options.indentation_m * resisted;
  // Into the tissue the finger itself moves at kApproachMS: the target goes as much faster as the resistance
  // takes, but not so fast that the hand pulls by its damper instead of its stiffness.
  const HandProfile& hand = options.hand;
  touched_s_ = hover_s_ + kHoverM / kApproachMS;
  pressed_s_ = touched_s_ + std::max(options.indentation_m / kApproachMS,
                                     hand.damping_n_s_m / (kByDamper * hand.stiffness_n_m));
  begun_s_ = pressed_s_ + kPressedS;
  stopped_s_ = begun_s_ + (sweep_m_ > 0 ? sweep_m_ / kSpeedMS + kSpeedMS / kAccelerationMS2 : 0);
}

double HandPath::depth(double time_s) const {
  return -kHoverM +
         std::clamp((time_s - hover_s_) / (pressed_s_ - hover_s_), 0.0, 1.0) * (kHoverM + depth_m_);
}

double HandPath::along(double time_s) const {
  if (sweep_m_ <= 0) return 0;
  const double ramp_s = kSpeedMS / kAccelerationMS2, cruise_s = sweep_m_ / kSpeedMS - ramp_s;
  const auto ramp_m = [](double s) { return kAccelerationMS2 * s * s / 2; };
  const double t = std::clamp(time_s - begun_s_, 0.0, stopped_s_ - begun_s_);
  const double left_s = std::clamp(stopped_s_ - begun_s_ - t, 0.0, ramp_s);
  return ramp_m(std::min(t, ramp_s)) + kSpeedMS * std::clamp(t - ramp_s, 0.0, cruise_s) + ramp_m(ramp_s) -
         ramp_m(left_s);
}

HandTarget HandPath::at(double time_s) const {
  const auto place = [this](double s) { return Vector3(kBeginM + along(s), depth(s), 0); };
  const Vector3 now_m = place(time_s);
  return {now_m, (place(time_s + kServoS) - now_m) / kServoS};
}

}  // namespace teletact::bench
