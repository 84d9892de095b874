#include "client/render/force_chain.h"

#include <algorithm>
#include <cmath>

namespace teletact::client {

ForceChain::ForceChain(const ForceChainOptions& options)
    : options_(options),
      passivity_({.largest_damping_n_s_m = options.limits.largest_damping_n_s_m,
                  .friction_n = options.limits.friction_n,
                  .mechanism_n_s_m = options.limits.damping_n_s_m}) {}

// How far the model's age and the energy balance let the rendered force be trusted.
void ForceChain::judge(const ForceChainInput& input, double dt_s, ForceChainOutput& output) noexcept {
  const AgeLimits ages = age_limits(input.period_s);
  const double aged = age_gain(input.model_age_s, ages);
  const double energy_j = passivity_.energy_j();
  indebted_ = energy_j < (indebted_ ? 0 : -options_.debt_limit_j);
  if (!input.on) {
    age_gain_ = aged;
    debt_gain_ = 1;
    indebted_ = false;
  }
  age_gain_ = std::min(aged, age_gain_ + options_.recover_1_s * dt_s);
  debt_gain_ =
      std::clamp(debt_gain_ + (indebted_ ? -options_.fade_1_s : options_.settle_1_s) * dt_s, 0.0, 1.0);
  const bool withholds = input.on && input.rendered.withheld > options_.withheld_share;
  withheld_s_ = withholds ? withheld_s_ + dt_s : 0;
  output.indebted = indebted_;
  output.withheld = withheld_s_ > options_.withheld_s;
  output.fades = !(input.model_age_s <= ages.degraded_s) || indebted_;
  output.degraded = output.fades || output.withheld;
}

// The force before slew: zero unless enabled, finite and in contact.
Vector2 ForceChain::wanted(const ForceChainInput& input, double dt_s, ForceChainOutput& output) noexcept {
  const ForceLimits& limits = options_.limits;
  // Silence, model age and the ramp scale the force and its ceiling alike, so that a force beyond the ceiling
  // fades with it and the slew limit can follow.
  output.silence_gain = silence_gain(input.silence_s, silence_limits(input.period_s));
  const double gain = output.silence_gain * age_gain_ * start_gain(input.enabled_s, options_.start_ramp_s);
  const double ceiling_n = gain * limits.largest_force_n;

  output.not_finite = !input.rendered.force_n.allFinite();
  if (output.not_finite || !input.on) return Vector2::Zero();
  const double indentation_m = input.pose.position_m.y() - input.surface_m;
  Vector2 force_n = cap_stiffness(gain * input.rendered.force_n, indentation_m, limits.largest_stiffness_n_m);
  force_n = debt_gain_ * cap_magnitude(force_n, ceiling_n);
  // A debt fades what is rendered, not the damping that pays it.
  force_n += passivity_.damping_force(input.pose.velocity_m_s, dt_s);
  return cap_magnitude(force_n, ceiling_n);
}

// A runaway is a fault for the state machine: the force then slews to zero instead of stepping there. A
// device may state its velocity late or not at all, so a jump of its position is one too.
bool ForceChain::too_fast(const ForceChainInput& input) noexcept {
  const ToolPose& pose = input.pose;
  const double largest_m_s = options_.limits.largest_speed_m_s;
  const double largest_m = largest_m_s * std::max(options_.jump_s, input.dt_s);
  const bool jumped = last_position_m_ && !((pose.position_m - *last_position_m_).norm() <= largest_m);
  last_position_m_.reset();
  if (pose.position_m.allFinite()) last_position_m_ = pose.position_m;
  return jumped || !(pose.velocity_m_s.norm() <= largest_m_s);
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
    // With the time that has passed, however late the tick.
    passivity_.observe(pose.position_m, last_force_n_, pose.position_m.y() > input.surface_m,
                       std::isfinite(input.dt_s) ? std::max(input.dt_s, 0.0) : 0);
  }
  judge(input, dt_s, output);
  Vector2 wanted_n = output.not_finite ? Vector2(Vector2::Zero()) : wanted(input, dt_s, output);
  if (!wanted_n.allFinite()) {  // whatever the way: nothing but numbers reaches the slew
    wanted_n.setZero();
    output.not_finite = true;
    passivity_.reset();
  }
  const ForceLimits& limits = options_.limits;
  Vector2 force_n = cap_slew(wanted_n, last_force_n_, limits.largest_slew_n_s, dt_s);
  force_n = cap_magnitude(force_n, limits.largest_force_n);
  output.too_fast = too_fast(input);
  output.force_n = last_force_n_ = force_n;
  output.damping_n_s_m = passivity_.damping_n_s_m();
  output.energy_j = passivity_.energy_j();
  return output;
}

}  // namespace teletact::client
