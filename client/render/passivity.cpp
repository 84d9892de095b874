#include "client/render/passivity.h"

#include <algorithm>
#include <cmath>

namespace teletact::client {

void PassivityController::reset() noexcept {
  *this = PassivityController(options_);
}

// In contact the mechanism's alone; in the air the hand's where nothing is stated of that.
double PassivityController::damping_counted_n_s_m(bool contact) const noexcept {
  const bool stated = options_.friction_n > 0 || options_.mechanism_n_s_m > 0;
  return contact || stated ? options_.mechanism_n_s_m : options_.hand_n_s_m;
}

void PassivityController::observe(const Vector3& position_m, const Vector3& written_force_n, double stored_j,
                                  bool contact, double dt_s) noexcept {
  if (!started_) last_position_m_ = position_m;
  started_ = true;
  const Vector3 step_m = position_m - last_position_m_;
  last_position_m_ = position_m;
  // D(n) = D(n-1) - f(n-1) . dp + f_c |dp| + b |dp|^2 / T - (S(n) - S(n-1))
  const double way_m = step_m.stableNorm();
  balance_j_ += -written_force_n.dot(step_m) + options_.friction_n * way_m;
  // A product that a jump of 1e300 m does not make NaN.
  if (dt_s > 0) balance_j_ += damping_counted_n_s_m(contact) * way_m * way_m / dt_s;
  const double held_j = std::isfinite(stored_j) ? std::max(stored_j, 0.0) : 0;
  balance_j_ -= held_j - stored_j_;
  stored_j_ = held_j;
  if (std::isnan(balance_j_)) balance_j_ = 0;  // energies without bound, of both signs: nothing is known
  balance_j_ = std::clamp(balance_j_, -options_.largest_debt_j, contact ? options_.largest_reserve_j : 0.0);
  dissipate(position_m, contact, dt_s);
}

// Over kSpanS at once: a straight way in one span is the least that friction and damping can have taken,
// however late a tick or a sample came, and a position that flickers between two steps of the encoder takes
// nothing.
void PassivityController::dissipate(const Vector3& position_m, bool contact, double dt_s) noexcept {
  dissipated_j_ = 0;
  if (!contact) span_s_ = 0;
  if (span_s_ == 0) span_begin_m_ = position_m;
  if (!contact) return;
  span_s_ += dt_s;
  if (span_s_ < kSpanS) return;
  const double way_m = (position_m - span_begin_m_).stableNorm();
  const auto damped_j = [&](double damping_n_s_m) { return damping_n_s_m * way_m * way_m / span_s_; };
  const bool stated = options_.friction_n > 0 || options_.mechanism_n_s_m > 0;
  dissipated_j_ = stated ? options_.friction_n * way_m + damped_j(options_.mechanism_n_s_m)
                         : damped_j(options_.hand_n_s_m);
  dissipated_j_ = std::min(dissipated_j_, options_.largest_reserve_j);
  span_s_ = 0;
}

Vector3 PassivityController::damping_force(const Vector3& velocity_m_s, double dt_s) noexcept {
  damping_n_s_m_ = 0;
  const double speed_squared = velocity_m_s.squaredNorm();
  constexpr double kStandstill = 1e-10;  // (m/s)^2: no damping can take energy from a finger at rest
  if (energy_j() >= 0 || speed_squared < kStandstill || dt_s <= 0) return Vector3::Zero();
  // alpha = -E / (T v^2); what the clamp leaves stays in E for the next ticks, and the force written (limits
  // included) is accounted by the next observe().
  damping_n_s_m_ = std::min(-energy_j() / (dt_s * speed_squared), options_.largest_damping_n_s_m);
  return -damping_n_s_m_ * velocity_m_s;
}

}  // namespace teletact::client
