#include "client/render/passivity.h"

#include <algorithm>

namespace teletact::client {

void PassivityController::reset() noexcept {
  *this = PassivityController(options_);
}

void PassivityController::observe(const Vector2& position_m, const Vector2& written_force_n, bool contact,
                                  double dt_s) noexcept {
  if (!started_) last_position_m_ = position_m;
  started_ = true;
  const Vector2 step_m = position_m - last_position_m_;
  last_position_m_ = position_m;
  // E(n) = E(n-1) - f(n-1) . dp + f_c |dp| + b |dp|^2 / T
  energy_j_ += -written_force_n.dot(step_m);
  dissipated_j_ = 0;
  if (contact) {
    const double way_m = step_m.stableNorm();
    const auto damped_j = [&](double damping_n_s_m) {  // a product that a jump of 1e300 m does not make NaN
      return dt_s > 0 ? damping_n_s_m * way_m * way_m / dt_s : 0;
    };
    dissipated_j_ = options_.friction_n * way_m + damped_j(options_.mechanism_n_s_m);
    energy_j_ += dissipated_j_;
    if (options_.friction_n == 0 && options_.mechanism_n_s_m == 0)
      dissipated_j_ = damped_j(options_.hand_n_s_m);
    dissipated_j_ = std::min(dissipated_j_, options_.largest_reserve_j);
  }
  energy_j_ = std::clamp(energy_j_, -options_.largest_debt_j, contact ? options_.largest_reserve_j : 0.0);
}

Vector2 PassivityController::damping_force(const Vector2& velocity_m_s, double dt_s) noexcept {
  damping_n_s_m_ = 0;
  const double speed_squared = velocity_m_s.squaredNorm();
  constexpr double kStandstill = 1e-10;  // (m/s)^2: no damping can take energy from a finger at rest
  if (energy_j_ >= 0 || speed_squared < kStandstill || dt_s <= 0) return Vector2::Zero();
  // alpha = -E / (T v^2); what the clamp leaves stays in E for the next ticks, and the force written (limits
  // included) is accounted by the next observe().
  damping_n_s_m_ = std::min(-energy_j_ / (dt_s * speed_squared), options_.largest_damping_n_s_m);
  return -damping_n_s_m_ * velocity_m_s;
}

}  // namespace teletact::client
