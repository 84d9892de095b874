// The energy of one contact, in one account. Whatever puts energy under a pressed finger that the finger has
// not put in itself asks here: a force that silence, age, ramp or clutch took and that comes back, a harder
// model or law, the border of a law. What falls earns, what is dissipated earns, what rises spends, and what
// is not there is not spent: refused. So what a lift gives back is what was put in and half a tick's K T/2
// (T7.4).
//
// Beside it stands the observer (T5.5, Hannaford and Ryu): it adds up the work that the operator does on what
// is rendered,
//     E(n) = E(n-1) - f(n-1) . (p(n) - p(n-1)),   f on the finger,
// which is exact for a force held between ticks. What the mechanism's own Coulomb friction dissipates,
// f_c |p(n) - p(n-1)|, and its own damping, b |p(n) - p(n-1)|^2 / T, count as put in: the pair of rendering
// and device has to be passive, not the rendering alone.
//
// Of E the model that is rendered holds S; D = E - S was dissipated. A press and its release move S alone. A
// model that gets harder takes dS from D, one that gets softer gives it. D is bounded: what was dissipated
// long ago does not hide what is generated now. S is an estimate, right to a quarter of it (a rounded tip's
// d^2.5, told by its force alone, is a fifth less than k d^2/2), so that D + S/4 < 0 says that energy has
// been generated: as the finger lifts the doubt goes to nothing. Damping alpha = -(D + S/4) / (T v^2) takes
// it back, clamped to the device's.
//
// Off contact nothing is held, and what was dissipated before is forgotten: each contact pays for itself.
// What is owed there still is paid off by what the mechanism dissipates in the air, or the hand.
#pragma once

#include "client/render/contact_frame.h"

namespace teletact::client {

// Who asks for energy: a gain that comes back, a harder answer (T5.4b), another model or law (T7.4), or the
// border of a law.
enum class EnergyClaim { kNone, kSilence, kAge, kClutch, kRamp, kAnswer, kModel, kLaw, kBorder };
const char* name(EnergyClaim) noexcept;

struct EnergyLedgerOptions {
  double largest_damping_n_s_m = 5;
  double friction_n = 0;
  double mechanism_n_s_m = 0;  // damping of the mechanism
  // The least of a hand at the handle. Of a display that states neither friction nor damping it is all that
  // surely dissipates; it pays for what comes back then, never for energy that the display generates.
  double hand_n_s_m = 2;
  double largest_balance_j = 0.02;  // no more is saved up, to be given back or to hide what is generated
  double held_share = 0.25;         // of what is held, that the estimate of it may be too large by
  // Nor is a debt kept beyond what a device can have given: damping has to end.
  double largest_debt_j = 0.1;
};

class EnergyLedger {
 public:
  explicit EnergyLedger(const EnergyLedgerOptions& options = {}) : options_(options) {}

  void reset() noexcept;
  // Once per tick, before the new force is known: the step made under the last force written. `stored_j`:
  // held by the model now.
  void observe(const Vector3& position_m, const Vector3& written_force_n, double stored_j, bool contact,
               double dt_s) noexcept;

  // Of a way that puts `energy_j` more under the finger, `share` is to be gone now: as much of that as is
  // paid for. A way to less (energy_j < 0) earns.
  double go(EnergyClaim who, double energy_j, double share) noexcept;
  // Paid for by what is known to be dissipated elsewhere.
  void earn(double energy_j) noexcept;
  double balance_j() const noexcept { return balance_j_; }  // may be given back
  struct Refused {
    EnergyClaim who = EnergyClaim::kNone;
    double lacks_j = 0;
  };
  Refused take_refused() noexcept;  // the largest since the last call

  // Of the rendered model's energy, what the gains let out: a renderer's claims are of that.
  double gain() const noexcept { return gain_; }
  void set_gain(double gain) noexcept { gain_ = gain; }

  // D + S/4 < 0: generated, however the estimate of what is held is off.
  double energy_j() const noexcept { return put_in_j_ - (1 - options_.held_share) * stored_j_; }
  double stored_j() const noexcept { return stored_j_; }
  double dissipated_j() const noexcept { return dissipated_j_; }  // in this contact, at least
  // The damping force to add for this tick, zero while passive.
  Vector3 damping_force(const Vector3& velocity_m_s, double dt_s) noexcept;
  double damping_n_s_m() const noexcept { return damping_n_s_m_; }

 private:
  static constexpr double kSpanS = 0.01;
  bool stated() const noexcept { return options_.friction_n > 0 || options_.mechanism_n_s_m > 0; }
  void dissipate(const Vector3& position_m, bool contact, double dt_s) noexcept;

  EnergyLedgerOptions options_;
  Vector3 last_position_m_ = Vector3::Zero();
  bool started_ = false;
  double put_in_j_ = 0;  // E, less what was dissipated beyond what is saved up
  double stored_j_ = 0;  // S
  double dissipated_j_ = 0, balance_j_ = 0, gain_ = 1, damping_n_s_m_ = 0;
  Refused refused_;
  Vector3 span_begin_m_ = Vector3::Zero();
  double span_s_ = 0;
};

}  // namespace teletact::client
