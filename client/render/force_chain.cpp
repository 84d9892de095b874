#include "client/render/force_chain.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace teletact::client {
namespace {

// How fast a law fades in silence: 7 % in 10 ms (T5.8).
constexpr double kLawFade1S = 1 / (kLawSilence.zero_s - kLawSilence.fade_s);

// Where the hand is: beside the pose while it is clutched, and as far beside it afterwards.
Vector3 hand_m(const ForceChainInput& input) {
  return input.pose.position_m + input.unseen.position_m;
}

Vector3 hand_m_s(const ForceChainInput& input) {
  return input.pose.velocity_m_s + input.unseen.velocity_m_s;
}

// Joules at the hand, in the scene's.
EnergyLedgerOptions ledger_of(const ForceLimits& limits) {
  EnergyLedgerOptions options{.largest_damping_n_s_m = limits.largest_damping_n_s_m,
                              .friction_n = limits.friction_n,
                              .mechanism_n_s_m = limits.damping_n_s_m,
                              .hand_n_s_m = limits.hand_n_s_m};
  options.largest_balance_j *= limits.joules_per_hand_j;
  options.largest_debt_j *= limits.joules_per_hand_j;
  return options;
}

double passed_s(const ForceChainInput& input) {
  return std::isfinite(input.dt_s) ? std::max(input.dt_s, 0.0) : 0;
}

}  // namespace

ForceChain::ForceChain(const ForceChainOptions& options)
    : options_(options), ledger_(ledger_of(options.limits)) {}

// How far the model's age and the energy balance let the rendered force be trusted.
void ForceChain::judge(const ForceChainInput& input, double dt_s, ForceChainOutput& output) noexcept {
  const AgeLimits ages = age_limits(input.period_s);
  const double aged = age_gain(input.model_age_s, ages);
  const double energy_j = ledger_.energy_j();
  const double debt_limit_j = options_.debt_limit_j * options_.limits.joules_per_hand_j;
  energy_generated_ = energy_j < (energy_generated_ ? 0 : -debt_limit_j);
  if (!input.on) {
    age_gain_ = aged;
    debt_gain_ = 1;
    energy_generated_ = false;
  }
  age_gain_ = std::min(aged, age_gain_ + options_.recover_1_s * dt_s);
  // A force that comes back puts energy under a pressed finger: no further than is paid for.
  const double settle_1_s = energy_j >= 0 ? options_.settle_1_s : 0;
  debt_gain_ =
      std::clamp(debt_gain_ + (energy_generated_ ? -options_.fade_1_s : settle_1_s) * dt_s, 0.0, 1.0);
  output.withheld = std::max(input.rendered.withheld, gain_short_);
  const bool withholds = input.on && output.withheld > options_.withheld_share;
  withheld_s_ = withholds ? withheld_s_ + dt_s : 0;
  output.energy_generated = energy_generated_;
  constexpr double kRoundingS = 1e-9;  // of ticks that are added up
  output.withholds = withheld_s_ > options_.withheld_s + kRoundingS;
  output.fades = !(age_gain_ >= 1) || energy_generated_;
  output.degraded = output.fades || output.withholds;
}

// The step made under the last force, in the time that has passed, however late the tick.
void ForceChain::observe(const ForceChainInput& input) noexcept {
  const bool contact = input.surface.depth_m(input.pose.position_m) > 0;
  ledger_.observe(hand_m(input), last_force_n_, contact ? share_ * input.rendered.stored_j : 0, contact,
                  passed_s(input));
}

// Of silence, age, the clutch and the ramp together. Where a law ends, in silence or because an older answer
// is all that is left, they do not step to what that is trusted: they fall no faster than a law fades.
void ForceChain::settle_gain(const ForceChainInput& input, double indentation_m, double dt_s) noexcept {
  const bool by_law = input.rendered.by_law;
  const double last = gain_, last_silence = silence_gain_, way = kLawFade1S * passed_s(input);
  const double silence = silence_gain(input.silence_s, silence_limits(input.period_s, by_law));
  law_fades_ = by_law || law_fades_;
  silence_gain_ = std::min(law_fades_ ? std::max(silence, last_silence - way) : silence,
                           silence_gain(input.silence_s, kLawSilence));
  const double clutch_way = input.clutched ? -dt_s / options_.clutch_fade_s : dt_s / options_.start_ramp_s;
  clutch_gain_ = input.on ? std::clamp(clutch_gain_ + clutch_way, 0.0, 1.0) : input.clutched ? 0.0 : 1.0;
  const std::array gains{silence_gain_, age_gain_, clutch_gain_,
                         start_gain(input.enabled_s, options_.start_ramp_s)};
  const auto least = std::min_element(gains.begin(), gains.end());
  if (*least < 1)
    took_ = std::array{EnergyClaim::kSilence, EnergyClaim::kAge, EnergyClaim::kClutch,
                       EnergyClaim::kRamp}[std::size_t(least - gains.begin())];
  const double wanted = gains[0] * gains[1] * gains[2] * gains[3];
  gain_ = law_fades_ ? std::max(wanted, std::min(last - way, silence_gain_)) : wanted;
  law_fades_ = by_law || (law_fades_ && (silence < last_silence || wanted < last));
  const double stored_j = input.rendered.stored_j;
  const double max_j = options_.limits.largest_force_n * std::max(indentation_m, 0.0);
  const double model_j = std::isfinite(stored_j) ? std::min(stored_j, max_j) : 0;
  // A fall earns what went out. A rise costs what the display's caps let out, whatever a debt fades of it:
  // the debt's own gain rises for nothing.
  const double held_j = (gain_ > last ? let_out_ : last > 0 ? std::min(share_ / last, 1.0) : 0) * model_j;
  gain_short_ = 0;
  law_touched_ = model_j > 0 && (by_law || law_touched_);
  // A finger that came in during the ramp feels answers once that is over.
  if (!(held_j > 0) || (took_ == EnergyClaim::kRamp && !law_touched_)) return;
  const double rise = gain_ - last, paid = last + ledger_.balance_j() / held_j;
  if (rise > 0 && paid < gain_) gain_short_ = 1 - paid / gain_;
  const double share = rise > 0 && by_law ? std::min(way / rise, 1.0) : 1;
  gain_ = last + rise * ledger_.go(took_, rise * held_j, share);
}

// The force before slew: zero unless enabled, finite and in contact.
Vector3 ForceChain::wanted(const ForceChainInput& input, double indentation_m, double dt_s,
                           ForceChainOutput& output) noexcept {
  const ForceLimits& limits = options_.limits;
  output.not_finite = !input.rendered.force_n.allFinite();
  if (output.not_finite || !input.on) return Vector3::Zero();
  // The gain scales the force and its ceiling alike, so that a force beyond the ceiling fades with it and the
  // slew limit can follow.
  const double ceiling_n = gain_ * limits.largest_force_n;
  const Vector3 soft_n =
      cap_stiffness(gain_ * input.rendered.force_n, indentation_m, limits.largest_stiffness_n_m);
  const Vector3 model_n = cap_magnitude(soft_n, ceiling_n);
  const double rendered_n = input.rendered.force_n.stableNorm(), soft = soft_n.stableNorm();
  // Of 1/2 k d^2 a softer spring holds its share, and one that is cut off at F_max 2 s - s^2, s the share of
  // the force that is left.
  const double left = soft > 0 ? model_n.stableNorm() / soft : 1;
  share_ = (rendered_n > 0 ? soft / rendered_n : gain_) * left * (2 - left);
  let_out_ = gain_ > 0 ? std::min(share_ / gain_, 1.0) : 1;
  share_ *= debt_gain_;
  // A debt fades what is rendered, not the damping that pays it; and that never pulls a finger in.
  Vector3 force_n = debt_gain_ * model_n + ledger_.damping_force(hand_m_s(input), dt_s);
  const Vector3& normal = input.surface.normal;
  const double max_n = std::max(debt_gain_ * normal.dot(model_n), 0.0);
  force_n -= std::max(normal.dot(force_n) - max_n, 0.0) * normal;
  force_n = cap_stiffness(force_n, indentation_m, limits.largest_stiffness_n_m);
  return cap_magnitude(force_n, ceiling_n);
}

// Nothing is wanted any more: down by the slew limit and with the silence, and to a finger that lifts no
// stiffer than before. Where nobody knows whether it lifts: faster, and however late the tick.
Vector3 ForceChain::fade(const ForceChainInput& input, double indentation_m, double dt_s) const noexcept {
  const ForceLimits& limits = options_.limits;
  const double slews_s = input.frozen ? 3 * passed_s(input) : dt_s;
  Vector3 force_n = cap_magnitude(cap_slew(Vector3::Zero(), last_force_n_, limits.largest_slew_n_s, slews_s),
                                  silence_gain_ * limits.largest_force_n);
  if (!(indentation_m < last_indentation_m_)) return force_n;
  return cap_stiffness(force_n, indentation_m, last_force_n_.norm() / last_indentation_m_);
}

// A runaway is a fault for the state machine: the force then slews to zero instead of stepping there. A
// device may state its velocity late or not at all, so a jump of its position is one too.
bool ForceChain::too_fast(const ForceChainInput& input) const noexcept {
  const double largest_m_s = options_.limits.largest_speed_m_s;
  const double largest_m = largest_m_s * std::max(options_.jump_s, input.dt_s);
  const bool jumped = last_hand_m_ && !((hand_m(input) - *last_hand_m_).norm() <= largest_m);
  return jumped || !(hand_m_s(input).norm() <= largest_m_s);
}

// From this tick to the next: by the slew limit, and as the finger itself presses in.
double ForceChain::largest_rise_n(const ForceChainInput& input, double indentation_m,
                                  double dt_s) const noexcept {
  const ForceLimits& limits = options_.limits;
  double pressed_m = 0;
  if (last_position_m_ && !too_fast(input))
    pressed_m = input.surface.normal.dot(input.pose.position_m - *last_position_m_);
  pressed_m = std::clamp(pressed_m, 0.0, std::max(indentation_m, 0.0));
  return limits.largest_slew_n_s * dt_s + limits.largest_stiffness_n_m * pressed_m;
}

ForceChainOutput ForceChain::apply(const ForceChainInput& input) noexcept {
  ForceChainOutput output;
  const ToolPose& pose = input.pose;
  const double dt_s = std::isfinite(input.dt_s) ? std::clamp(input.dt_s, 0.0, options_.longest_dt_s) : 0;
  // Where the finger is not known it is taken to be where it was.
  double indentation_m = last_indentation_m_;
  const double depth_m = input.surface.depth_m(pose.position_m);
  if (!pose.position_m.allFinite() || !pose.velocity_m_s.allFinite() || !std::isfinite(depth_m)) {
    output.not_finite = true;
  } else {
    indentation_m = depth_m;
    if (input.on) observe(input);
  }
  judge(input, dt_s, output);
  settle_gain(input, indentation_m, dt_s);
  output.silence_gain = silence_gain_;
  output.clutch_gain = clutch_gain_;
  Vector3 wanted_n = Vector3::Zero();
  if (!output.not_finite) wanted_n = wanted(input, indentation_m, dt_s, output);
  if (!wanted_n.allFinite()) output.not_finite = true;  // whatever the way: nothing but numbers goes out
  const bool fades = !input.on || output.not_finite;
  const Vector3 force_n = fades
                              ? fade(input, indentation_m, dt_s)
                              : cap_rise(wanted_n, last_force_n_, largest_rise_n(input, indentation_m, dt_s));
  if (fades) {
    ledger_.reset();
    share_ = gain_ = gain_short_ = 0;
    law_touched_ = false;
  } else if (force_n.norm() < wanted_n.norm()) {
    share_ *= force_n.norm() / wanted_n.norm();
  }
  output.too_fast = too_fast(input);
  output.force_n = last_force_n_ = force_n;
  last_indentation_m_ = indentation_m;
  last_position_m_.reset();
  last_hand_m_.reset();
  if (pose.position_m.allFinite()) last_position_m_ = pose.position_m;
  if (hand_m(input).allFinite()) last_hand_m_ = hand_m(input);
  ledger_.set_gain(took_ == EnergyClaim::kRamp && !law_touched_ ? 1 : debt_gain_ * gain_);
  output.damping_n_s_m = ledger_.damping_n_s_m();
  output.energy_j = ledger_.energy_j();
  output.stored_j = ledger_.stored_j();
  output.balance_j = ledger_.balance_j();
  output.refused = ledger_.take_refused();
  return output;
}

}  // namespace teletact::client
