// Passivity observer and controller (T5.5, Hannaford and Ryu), in the plane.
//
// The observer adds up the work that the operator does on what is rendered,
//     E(n) = E(n-1) - f(n-1) . (p(n) - p(n-1)),   f on the finger,
// which is exact for a force held between ticks. What the mechanism's own Coulomb friction dissipates,
// f_c |p(n) - p(n-1)|, and its own damping, b |p(n) - p(n-1)|^2 / T, count for the budget: the pair of
// rendering and device has to be passive, not the rendering alone. When E < 0 energy has been generated;
// damping alpha = -E / (T v^2) takes it back, clamped to the device's. Off contact nothing is stored, so what
// was dissipated before is forgotten: each contact pays for itself.
#pragma once

#include "client/render/renderer.h"

namespace teletact::client {

class PassivityController {
 public:
  struct Options {
    double largest_damping_n_s_m = 5;
    double friction_n = 0;
    double mechanism_n_s_m = 0;  // damping of the mechanism
    // The least of a hand at the handle (T5.7). Of a display that states neither friction nor damping it is
    // all that surely dissipates; it pays for harder models then, never for energy that the display
    // generates.
    double hand_n_s_m = 2;
    // Dissipation is not saved up beyond this: an observer with a large reserve notices generation late.
    double largest_reserve_j = 0.02;
    // Nor is a debt kept beyond what a device can have given: damping has to end.
    double largest_debt_j = 0.1;
  };
  explicit PassivityController(const Options& options) : options_(options) {}

  void reset() noexcept;
  // Call once per tick, before the new force is known: accounts for the step made under the last force
  // written.
  void observe(const Vector2& position_m, const Vector2& written_force_n, bool contact, double dt_s) noexcept;
  // The damping force to add for this tick, zero while passive.
  Vector2 damping_force(const Vector2& velocity_m_s, double dt_s) noexcept;

  double energy_j() const noexcept { return energy_j_; }  // > 0: dissipated or stored
  double damping_n_s_m() const noexcept { return damping_n_s_m_; }
  // At least, in contact, since it was not zero last, for the renderer's budget: by the mechanism, or by the
  // hand if nothing is stated of that. Told every kSpanS.
  double dissipated_j() const noexcept { return dissipated_j_; }

 private:
  static constexpr double kSpanS = 0.01;
  void dissipate(const Vector2& position_m, bool contact, double dt_s) noexcept;

  Options options_;
  Vector2 last_position_m_ = Vector2::Zero();
  bool started_ = false;
  double energy_j_ = 0;
  double dissipated_j_ = 0;
  Vector2 span_begin_m_ = Vector2::Zero();
  double span_s_ = 0;
  double damping_n_s_m_ = 0;
};

}  // namespace teletact::client
