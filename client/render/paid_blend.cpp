#include "client/render/paid_blend.h"

#include <algorithm>
#include <cmath>

namespace teletact::client {

void PaidBlend::clear() noexcept {
  withheld_ = 0;
  offset_n_m_.setZero();
}

// Of a harder model the surplus is withheld, the rest is an offset.
void PaidBlend::change(const Vector3& felt_n_m, const Vector3& model_n_m) noexcept {
  withheld_ = model_n_m.y() > felt_n_m.y() ? 1 - felt_n_m.y() / model_n_m.y() : 0;
  offset_n_m_ = felt_n_m - (1 - withheld_) * model_n_m;
}

// No faster than `largest_jump`, and no more of what is withheld than is paid for.
void PaidBlend::settle(const Vector3& model_n_m, double indentation_m, double elapsed_s, EnergyLedger& ledger,
                       double share) noexcept {
  constexpr double kMaxTicks = 1000;  // all is blended in by then
  const double ticks = std::clamp(elapsed_s / options_.servo_period_s, 0.0, kMaxTicks);
  // 1/2 d^2: energy per stiffness, as far as it goes out.
  const double half_square = share * ledger.gain() * indentation_m * indentation_m / 2;
  const double felt_n_m = (offset_n_m_ + (1 - withheld_) * model_n_m).norm();
  double step_n_m = std::max(std::expm1(ticks * std::log1p(options_.largest_jump)) * felt_n_m,
                             ticks * options_.unfelt_jump_n / indentation_m);
  const double missing_n_m = withheld_ * std::max(model_n_m.y(), 0.0);
  if (missing_n_m > 0) {
    const double step = std::min(1.0, step_n_m / missing_n_m);
    const double gone = ledger.go(EnergyClaim::kAnswer, half_square * missing_n_m, step);
    withheld_ -= withheld_ * gone;
    step_n_m -= gone * missing_n_m;
  }
  const double offset_n_m = offset_n_m_.norm();
  if (offset_n_m > 0) {
    const Vector3 less_n_m = std::min(1.0, step_n_m / offset_n_m) * offset_n_m_;
    offset_n_m_ -= less_n_m;
    ledger.go(EnergyClaim::kAnswer, -half_square * std::max(less_n_m.y(), 0.0), 1);
  }
}

}  // namespace teletact::client
