// The limits that stand between a rendered force and a device, as pure functions. The order in which they are
// applied is force_chain.h's.
#pragma once

#include "client/render/renderer.h"

namespace teletact::client {

// What a device may be asked for (a profile of T5.7, see haptic/profiles.h).
struct ForceLimits {
  double largest_force_n = 3.3;
  double largest_stiffness_n_m = 700;
  double largest_damping_n_s_m = 5;
  double largest_slew_n_s = 130;
  double largest_speed_m_s = 1.0;  // faster than any exploring hand: the device runs away
  double friction_n = 0;           // Coulomb friction of the mechanism: dissipates, never generates
  double damping_n_s_m = 0;        // viscous, of the mechanism, as far as it is known
  double hand_n_s_m = 2;           // the least damping of a hand at the handle (T5.7)
  double joules_per_hand_j = 1;    // of these forces and ways, per joule at the hand: a workspace map's
};

// When silence since the last answer starts to fade the force, and when it is zero: past max(50 ms, 2
// periods), zero a few ms before three times that but at most 0.5 s. A period over 125 ms fades from 0.25 s
// on. The period is the one expected: negotiated, or what the link has shown (link/arrival_intervals.h).
struct SilenceLimits {
  double fade_s = 0.05;
  double zero_s = 0.142;
};
// A contact law stays true without answers: past 0.34 s, whatever the period.
constexpr SilenceLimits kLawSilence{.fade_s = 0.34, .zero_s = 0.492};
SilenceLimits silence_limits(double expected_period_s, bool by_law = false) noexcept;

// 1 while fresh, falling linearly to 0 from fade_s to zero_s; 0 for NaN.
double silence_gain(double silence_s, const SilenceLimits&) noexcept;

// Model age past which answers are DEGRADED and fade, and where they are nothing: 0.25 s, or where answers
// are few what one that came 0.2 s late grows to before the next, but at most 0.4 s; and 0.5 s.
struct AgeLimits {
  double degraded_s = 0.25;
  double zero_s = 0.5;
};
AgeLimits age_limits(double expected_period_s) noexcept;

// 1 up to degraded_s, falling linearly to 0 at zero_s; 0 for NaN.
double age_gain(double model_age_s, const AgeLimits&) noexcept;

// 0 at the start, 1 after `ramp_s`; 0 for NaN.
double start_gain(double enabled_s, double ramp_s) noexcept;

// |force| <= stiffness x indentation; zero outside of the tissue.
Vector3 cap_stiffness(const Vector3& force_n, double indentation_m, double stiffness_n_m) noexcept;

// |force| <= largest, its direction kept.
Vector3 cap_magnitude(const Vector3& force_n, double largest_n) noexcept;

// From `previous_n` straight towards `force_n`: freely as far as the magnitude falls, from there on by
// `rise_n` at most. A force is never held up by this limit.
Vector3 cap_rise(const Vector3& force_n, const Vector3& previous_n, double rise_n) noexcept;

// The force nearest to `force_n` within slew x dt of `previous_n`, whichever way: for a fade.
Vector3 cap_slew(const Vector3& force_n, const Vector3& previous_n, double slew_n_s, double dt_s) noexcept;

}  // namespace teletact::client
