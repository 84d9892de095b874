#include "client/render/force_chain.h"

#include <algorithm>
#include <cmath>

namespace teletact::client {

ForceChain::ForceChain(const ForceChainOptions& options)
    : options_(options),
      passivity_({.largest_damping_n_s_m = options.limits.largest_damping_n_s_m,
                  .friction_n = options.limits.friction_n}) {}

// The force before slew: zero unless enabled, finite and in contact.
Vector2 ForceChain::wanted(const ForceChainInput& input, double dt_s, ForceChainOutput& output) noexcept {
  const ForceLimits& limits = options_.limits;
  // Silence, model age and the ramp scale the force and its ceiling alike, so that a force beyond the ceiling
  // fades with it and the slew limit can follow.
  output.silence_gain = silence_gain(input.silence_s, silence_limits(input.period_s));
  output.degraded = !(input.model_age_s <= options_.model_age_limit_s);
  const double gain = output.silence_gain * age_gain(input.model_age_s, options_.model_age_limit_s) *
                      start_gain(input.enabled_s, options_.start_ramp_s);
  const double ceiling_n = gain * limits.largest_force_n;

  output.not_finite = !input.rendered.force_n.allFinite();
  if (output.not_finite || !input.on) return Vector2::Zero();
  const double indentation_m = input.pose.position_m.y() - input.surface_m;
  Vector2 force_n = cap_stiffness(gain * input.rendered.force_n, indentation_m, limits.largest_stiffness_n_m);
  force_n = cap_magnitude(force_n, ceiling_n);
  force_n += passivity_.damping_force(input.pose.velocity_m_s, dt_s);
  return cap_magnitude(force_n, ceiling_n);
}

ForceChainOutput ForceChain::apply(const ForceChainInput& input) noexcept {
  ForceChainOutput output;
  const ToolPose& pose = input.pose;
  const double dt_s = std::isfinite(input.dt_s) ? std::clamp(input.dt_s, 0.0, options_.longest_dt_s) : 0;
  if (!pose.position_m.allFinite() || !pose.velocity_m_s.allFinite() || !std::isfinite(input.surface_m)) {
    output.not_finite = true;
    passivity_.reset();
  } else if (!input.on) {
    passivity_.reset();
  } else {
    passivity_.observe(pose.position_m, last_force_n_, pose.position_m.y() > input.surface_m);
  }
  const Vector2 wanted_n = output.not_finite ? Vector2(Vector2::Zero()) : wanted(input, dt_s, output);
  const ForceLimits& limits = options_.limits;
  Vector2 force_n = cap_slew(wanted_n, last_force_n_, limits.largest_slew_n_s, dt_s);
  force_n = cap_magnitude(force_n, limits.largest_force_n);
  // A runaway is a fault for the state machine: the force then slews to zero instead of stepping there.
  output.too_fast = !(pose.velocity_m_s.norm() <= limits.largest_speed_m_s);
  output.force_n = last_force_n_ = force_n;
  output.damping_n_s_m = passivity_.damping_n_s_m();
  output.energy_j = passivity_.energy_j();
  return output;
}

}  // namespace teletact::client
