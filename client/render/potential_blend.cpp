#include "client/render/potential_blend.h"

#include <algorithm>
#include <cmath>

namespace teletact::client {

void PotentialBlend::clear() noexcept {
  *this = PotentialBlend(options_);
}

// A power outside of what a contact has is none: the force, or the energy, is the lesser one then.
void PotentialBlend::change(EnergyClaim why, const Potential& felt, const Vector2& along_m,
                            double indentation_m) noexcept {
  constexpr double kMin = 1, kMax = 6;
  const double work_j = felt.resistance_n.y() * indentation_m;
  why_ = why;
  share_ = 0;
  energy_j_ = 0;
  along_m_ = along_m, indentation_m_ = indentation_m;
  if (!(work_j > 0 && felt.energy_j > 0)) return;
  power_ = std::clamp(work_j / felt.energy_j, kMin, kMax);
  energy_j_ = std::min(felt.energy_j, work_j / power_);
  slope_1_m_ = lateral(felt.resistance_n) / energy_j_;
}

Potential PotentialBlend::before(const Vector2& along_m, double indentation_m) const noexcept {
  if (!(energy_j_ > 0)) return {};
  const double bent = std::tanh(slope_1_m_.dot(along_m - along_m_));
  Potential phi;
  phi.energy_j = energy_j_ * std::pow(indentation_m / indentation_m_, power_) * std::exp(bent);
  const Vector2 along_n = phi.energy_j * (1 - bent * bent) * slope_1_m_;
  phi.resistance_n = {along_n.x(), power_ * phi.energy_j / indentation_m, along_n.y()};
  return phi;
}

Potential PotentialBlend::settle(const Potential& model, const Vector2& along_m, double indentation_m,
                                 double elapsed_s, EnergyLedger& ledger) noexcept {
  constexpr double kMaxTicks = 1000;  // all is blended in by then
  withheld_ = 0;
  if (settled()) return model;
  const Potential old = before(along_m, indentation_m);
  const auto felt = [&] {
    return Potential{old.resistance_n + share_ * (model.resistance_n - old.resistance_n),
                     old.energy_j + share_ * (model.energy_j - old.energy_j)};
  };
  const double ticks = std::clamp(elapsed_s / options_.servo_period_s, 0.0, kMaxTicks);
  // Towards nothing a share of what is left would never end: of what was felt before.
  const double of_n = (model.energy_j > 0 ? felt() : old).resistance_n.norm();
  const double step_n =
      std::expm1(ticks * std::log1p(options_.largest_jump)) * of_n + ticks * options_.unfelt_jump_n;
  const double way_n = (model.resistance_n - old.resistance_n).norm(), rise_j = model.energy_j - old.energy_j;
  if (!std::isfinite(rise_j)) {  // for the safety chain to judge
    clear();
    return model;
  }
  const double left = 1 - share_, step = way_n > step_n ? std::min(step_n / way_n / left, 1.0) : 1;
  const double gone = ledger.go(why_, ledger.gain() * left * rise_j, step);
  share_ = gone < 1 ? share_ + gone * left : 1;
  if (settled()) return model;
  Potential now = felt();
  if (rise_j > 0 && model.resistance_n.y() > 0)
    withheld_ = std::clamp(1 - now.resistance_n.y() / model.resistance_n.y(), 0.0, 1.0);
  return now;
}

}  // namespace teletact::client
