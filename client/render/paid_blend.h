// From what was felt to what a model says, so slowly that no servo period passes more than a few percent of
// the force, and no harder than is paid for (T5.4b). A softer model gives up stored energy as it is blended
// in. A harder one would put energy under the pressed finger that nobody has put in: its surplus, 1/2 dk d^2,
// is withheld until the ledger pays for it (energy_ledger.h). Both end at the surface.
//
// All in stiffness, resistance over indentation, by the contact's axes (contact_frame.h).
#pragma once

#include <algorithm>

#include "client/render/contact_frame.h"
#include "client/render/energy_ledger.h"

namespace teletact::client {

struct PaidBlendOptions {
  double servo_period_s = 0.001;
  double largest_jump = 0.06;    // of the force, per servo period: 7 % (T5.8) less what the finger moves
  double unfelt_jump_n = 0.005;  // so that a first contact does not take for ever
};

class PaidBlend {
 public:
  explicit PaidBlend(const PaidBlendOptions& options = {}) : options_(options) {}

  // Felt: (1 - withheld) x model + offset.
  Vector3 felt(const Vector3& model_n_m) const noexcept {
    Vector3 k = offset_n_m_ + (1 - withheld_) * model_n_m;
    k.y() = std::max(k.y(), 0.0);  // tissue never pulls
    return k;
  }
  double withheld() const noexcept { return withheld_; }
  const Vector3& offset_n_m() const noexcept { return offset_n_m_; }

  // Another model: what is felt stays what it was.
  void change(const Vector3& felt_n_m, const Vector3& model_n_m) noexcept;
  // `elapsed_s` further towards the model, of whose energy `share` is let out.
  void settle(const Vector3& model_n_m, double indentation_m, double elapsed_s, EnergyLedger& ledger,
              double share) noexcept;
  // At the surface, whoever comes anew feels the model as it is.
  void clear() noexcept;

 private:
  PaidBlendOptions options_;
  double withheld_ = 0;
  Vector3 offset_n_m_ = Vector3::Zero();
};

}  // namespace teletact::client
