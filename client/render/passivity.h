// Passivity observer and controller (T5.5, Hannaford and Ryu).
//
// The observer adds up the work that the operator does on what is rendered,
//     E(n) = E(n-1) - f(n-1) . (p(n) - p(n-1)),   f on the finger,
// which is exact for a force held between ticks. What the mechanism's own Coulomb friction dissipates,
// f_c |p(n) - p(n-1)|, and its own damping, b |p(n) - p(n-1)|^2 / T, count for the budget: the pair of
// rendering and device has to be passive, not the rendering alone.
//
// Of E the model that is rendered holds S; D = E - S was dissipated. A press and its release move S alone. A
// model that gets harder takes dS from D, one that gets softer gives it. D alone is bounded from above: what
// was dissipated long ago does not hide what is generated now. S is an estimate, right to a quarter of it (a
// rounded tip's d^2.5, told by its force alone, is a fifth less than k d^2/2), so that D + S/4 < 0 says that
// energy has been generated: as the finger lifts the doubt goes to nothing. Damping alpha = -(D + S/4) / (T
// v^2) takes it back, clamped to the device's.
//
// Off contact nothing is held, and what was dissipated before is forgotten: each contact pays for itself.
// What is owed there still is paid off by what the mechanism dissipates in the air, or the hand.
#pragma once

#include "client/render/renderer.h"

namespace teletact::client {

class PassivityController {
 public:
  struct Options {
    double largest_damping_n_s_m = 5;
    double friction_n = 0;
    double mechanism_n_s_m = 0;  // damping of the mechanism
    // The least of a hand at the handle. Of a display that states neither friction nor damping it is
    // all that surely dissipates; it pays for harder models then, never for energy that the display
    // generates.
    double hand_n_s_m = 2;
    // Dissipation is not saved up beyond this: an observer with a large reserve notices generation late.
    double largest_reserve_j = 0.02;
    double held_share = 0.25;  // of what is held, that the estimate of it may be too large by
    // Nor is a debt kept beyond what a device can have given: damping has to end.
    double largest_debt_j = 0.1;
  };
  explicit PassivityController(const Options& options) : options_(options) {}

  void reset() noexcept;
  // Call once per tick, before the new force is known: accounts for the step made under the last force
  // written. `stored_j`: held by the model now.
  void observe(const Vector3& position_m, const Vector3& written_force_n, double stored_j, bool contact,
               double dt_s) noexcept;
  // The damping force to add for this tick, zero while passive.
  Vector3 damping_force(const Vector3& velocity_m_s, double dt_s) noexcept;

  // < 0: generated, however the estimate of what is held is off.
  double energy_j() const noexcept { return balance_j_ + options_.held_share * stored_j_; }
  double stored_j() const noexcept { return stored_j_; }
  double damping_n_s_m() const noexcept { return damping_n_s_m_; }
  // At least, in contact, since it was not zero last, for the renderer's budget: by the mechanism, or by the
  // hand if nothing is stated of that. Told every kSpanS.
  double dissipated_j() const noexcept { return dissipated_j_; }

 private:
  static constexpr double kSpanS = 0.01;
  double damping_counted_n_s_m(bool contact) const noexcept;
  void dissipate(const Vector3& position_m, bool contact, double dt_s) noexcept;

  Options options_;
  Vector3 last_position_m_ = Vector3::Zero();
  bool started_ = false;
  double balance_j_ = 0;  // D
  double stored_j_ = 0;   // S
  double dissipated_j_ = 0;
  Vector3 span_begin_m_ = Vector3::Zero();
  double span_s_ = 0;
  double damping_n_s_m_ = 0;
};

}  // namespace teletact::client
