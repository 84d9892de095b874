// From what is felt to what another model says, as a mixture of potentials, Phi = (1 - a) Phi_0 + a Phi_1: at
// any a it is conservative itself. a rises so slowly that at a fixed pose a tenth of a second passes from one
// to the other, and its energy goes through the ledger (T7.4): at a fixed pose Phi that falls earns, Phi that
// rises spends (energy_ledger.h). Out of contact all is free.
//
// Phi_0 is what was felt when the model changed, carried on from that place: e (d / d_0)^p exp(tanh(q . (u -
// u_0))), whose energy and force there are those that were felt. So whatever is changed from, a mixture too,
// is a few numbers, and nothing steps: neither the force nor the energy, where that is a contact's.
#pragma once

#include "client/render/contact_frame.h"
#include "client/render/energy_ledger.h"

namespace teletact::client {

// At one place, in the contact's axes (contact_frame.h).
struct Potential {
  Vector3 resistance_n = Vector3::Zero();  // its gradient: the force on the finger, its sign turned
  double energy_j = 0;
};

struct PotentialBlendOptions {
  double servo_period_s = 0.001;
  double largest_jump = 0.006;    // of the force, per servo period: less than 7 % in 10 ms (T5.8), and
  double unfelt_jump_n = 0.0002;  // so much, so that it does not take for ever from nothing
};

class PotentialBlend {
 public:
  explicit PotentialBlend(const PotentialBlendOptions& options = {}) : options_(options) {}

  // Another model from now on, and why: `felt` is what was felt last, at this place.
  void change(EnergyClaim why, const Potential& felt, const Vector2& along_m, double indentation_m) noexcept;
  // What is felt there, `elapsed_s` further towards the model. Indentation > 0.
  Potential settle(const Potential& model, const Vector2& along_m, double indentation_m, double elapsed_s,
                   EnergyLedger& ledger) noexcept;
  // At the surface, whoever comes anew feels the model as it is.
  void clear() noexcept;

  bool settled() const noexcept { return share_ >= 1; }
  double share() const noexcept { return share_; }  // of the model
  // Of the model's resistance along the push, where it holds more energy than what was felt before; 0 .. 1.
  double withheld() const noexcept { return withheld_; }

 private:
  Potential before(const Vector2& along_m, double indentation_m) const noexcept;

  PotentialBlendOptions options_;
  double share_ = 1;  // a
  // Phi_0.
  double energy_j_ = 0, power_ = 0, indentation_m_ = 0;
  Vector2 along_m_ = Vector2::Zero(), slope_1_m_ = Vector2::Zero();  // u_0, q
  EnergyClaim why_ = EnergyClaim::kNone;
  double withheld_ = 0;
};

}  // namespace teletact::client
