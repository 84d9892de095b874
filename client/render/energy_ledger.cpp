#include "client/render/energy_ledger.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace teletact::client {

const char* name(EnergyClaim claim) noexcept {
  switch (claim) {
    case EnergyClaim::kNone:
      break;
    case EnergyClaim::kSilence:
      return "the force that silence took";
    case EnergyClaim::kAge:
      return "the force that old answers took";
    case EnergyClaim::kClutch:
      return "the force that the clutch took";
    case EnergyClaim::kRamp:
      return "the start ramp";
    case EnergyClaim::kAnswer:
      return "a harder answer";
    case EnergyClaim::kModel:
      return "another model";
    case EnergyClaim::kLaw:
      return "another contact law";
    case EnergyClaim::kBorder:
      return "the border of a contact law";
  }
  return "nothing";
}

void EnergyLedger::reset() noexcept {
  *this = EnergyLedger(options_);
}

void EnergyLedger::observe(const Vector3& position_m, const Vector3& written_force_n, double stored_j,
                           bool contact, double dt_s) noexcept {
  if (!started_) last_position_m_ = position_m;
  started_ = true;
  const Vector3 step_m = position_m - last_position_m_;
  last_position_m_ = position_m;
  // E(n) = E(n-1) - f(n-1) . dp + f_c |dp| + b |dp|^2 / T; in the air b is the hand's if nothing is stated.
  const double way_m = step_m.stableNorm();
  const double damping_n_s_m = contact || stated() ? options_.mechanism_n_s_m : options_.hand_n_s_m;
  put_in_j_ += -written_force_n.dot(step_m) + options_.friction_n * way_m;
  // A product that a jump of 1e300 m does not make NaN.
  if (dt_s > 0) put_in_j_ += damping_n_s_m * way_m * way_m / dt_s;
  stored_j_ = std::isfinite(stored_j) ? std::max(stored_j, 0.0) : 0;
  if (std::isnan(put_in_j_)) put_in_j_ = stored_j_;  // without bound, of both signs: nothing is known
  put_in_j_ = std::clamp(put_in_j_, stored_j_ - options_.largest_debt_j,
                         stored_j_ + (contact ? options_.largest_balance_j : 0.0));
  dissipate(position_m, contact, dt_s);
}

// Over kSpanS at once: a straight way in one span is the least that friction and damping can have taken,
// however late a tick or a sample came, and a position that flickers between two steps of the encoder takes
// nothing.
void EnergyLedger::dissipate(const Vector3& position_m, bool contact, double dt_s) noexcept {
  if (!contact) span_s_ = dissipated_j_ = balance_j_ = 0;
  if (span_s_ == 0) span_begin_m_ = position_m;
  if (!contact) return;
  span_s_ += dt_s;
  if (span_s_ < kSpanS) return;
  const double way_m = (position_m - span_begin_m_).stableNorm();
  const double damping_n_s_m = stated() ? options_.mechanism_n_s_m : options_.hand_n_s_m;
  earn(options_.friction_n * way_m + damping_n_s_m * way_m * way_m / span_s_);
  span_s_ = 0;
}

void EnergyLedger::earn(double energy_j) noexcept {
  if (!(energy_j > 0)) return;  // what is no number earns nothing
  dissipated_j_ += energy_j;
  balance_j_ = std::min(balance_j_ + energy_j, options_.largest_balance_j);
}

double EnergyLedger::go(EnergyClaim who, double energy_j, double share) noexcept {
  const double cost_j = share * energy_j;
  if (cost_j <= balance_j_) {
    balance_j_ = std::min(balance_j_ - cost_j, options_.largest_balance_j);
    return share;
  }
  if (!std::isfinite(energy_j)) return 0;
  const double given_j = std::exchange(balance_j_, 0.0);
  if (energy_j - given_j > refused_.lacks_j) refused_ = {who, energy_j - given_j};
  return given_j / energy_j;
}

EnergyLedger::Refused EnergyLedger::take_refused() noexcept {
  return std::exchange(refused_, {});
}

Vector3 EnergyLedger::damping_force(const Vector3& velocity_m_s, double dt_s) noexcept {
  damping_n_s_m_ = 0;
  const double speed_squared = velocity_m_s.squaredNorm();
  constexpr double kStandstill = 1e-10;  // (m/s)^2: no damping can take energy from a finger at rest
  if (energy_j() >= 0 || speed_squared < kStandstill || dt_s <= 0) return Vector3::Zero();
  // alpha = -(D + S/4) / (T v^2); what the clamp leaves is owed at the next ticks, and the force written
  // (limits included) is accounted by the next observe().
  damping_n_s_m_ = std::min(-energy_j() / (dt_s * speed_squared), options_.largest_damping_n_s_m);
  return -damping_n_s_m_ * velocity_m_s;
}

}  // namespace teletact::client
