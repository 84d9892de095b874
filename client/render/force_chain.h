// The safety chain, in this order: silence, model age, finite, stiffness cap, passivity, slew, velocity; and
// the start-up ramp. DEGRADED is a model past its age limit, or a display that has given more energy than its
// controller could take back: both fade the force; or a force of which a good part is withheld, until it is
// paid for.
//
// Whatever comes in, what goes out
//   - is finite, and |F| <= F_max;
//   - is |F| <= stiffness cap x indentation, and so nothing outside of the tissue, sideways as along the
//   push,
//     from the very tick at which the finger is read there;
//   - rises by slew x dt at most, beyond the stiffness cap x the finger's own way in: a force that lagged
//   behind a
//     quick press would come later, and nobody would have done its work;
//   - falls as fast as the model does: no limit holds a force up;
//   - fades by the slew limit after a fault, a pause or silence, by three times that after a frozen position,
//     and at least as fast as the finger lifts.
// What silence, age, the clutch and, where a law is felt, the ramp have taken from a contact comes back no
// further than the ledger pays for (energy_ledger.h): their falls earn, and so does what is dissipated.
// A clutched finger stands still in the scene while the hand moves: its force fades, and comes back by the
// ramp once it is released; what the hand does meanwhile is counted. So what the display gives back in a lift
// is no more than what the model held and half a tick's K T/2.
#pragma once

#include <optional>

#include "client/render/energy_ledger.h"
#include "client/render/force_limits.h"
#include "client/render/renderer.h"

namespace teletact::client {

struct ForceChainOptions {
  ForceLimits limits;
  // More energy generated than this, at the hand, after the controller: DEGRADED, and faded until the rest is
  // paid for. It is what throws a hand of 0.1 kg at 0.3 m/s; a first press into tissue not known yet stays
  // below.
  double debt_limit_j = 5e-3;
  // More than this of the stiffness withheld for longer than a hand-over takes: DEGRADED.
  double withheld_share = 0.2;
  double withheld_s = 0.05;
  double fade_1_s = 5;    // how fast a debt fades the force
  double settle_1_s = 2;  // how fast it returns once paid
  // How fast trust comes back, after a debt or an old model: slower than answers come, or they would shake
  // it.
  double recover_1_s = 0.5;
  double start_ramp_s = 0.5;
  double clutch_fade_s = 0.1;   // in which a clutched finger's force is gone; a law takes 0.15 s
  double longest_dt_s = 0.002;  // a tick that comes later than this slews no further
  double jump_s =
      0.01;  // a position further on than the speed limit gets in this, or since the last tick: too fast
};

struct ForceChainInput {
  Rendered rendered;
  ToolPose pose;
  ToolPose unseen = {};   // of the hand, clutched: haptic_device.h
  bool clutched = false;  // the hand moves, the pose stands still
  TouchedSurface surface = {};
  bool on = false;         // state ENABLED: else the force slews to zero
  bool frozen = false;     // it is off as the position is not of now
  double enabled_s = 0;    // since the state became ENABLED
  double silence_s = 0;    // since the last answer arrived
  double model_age_s = 0;  // since the pose behind the answer was sampled
  double period_s = 0;     // expected between answers
  double dt_s = 0.001;     // since the last tick
};

struct ForceChainOutput {
  Vector3 force_n = Vector3::Zero();
  double damping_n_s_m = 0;  // added by the passivity controller
  double energy_j = 0;       // the passivity observer's
  double stored_j = 0;       // held by the model, as far as its force goes out
  double silence_gain = 1;
  double clutch_gain = 1;  // 0: clutched, no force; between: it goes or comes back
  double balance_j = 0;    // may be given back in this contact
  EnergyLedger::Refused refused = {};
  bool degraded = false;          // model age or energy generated past its limit, or force withheld
  bool energy_generated = false;  // the second of them
  bool withholds = false;         // the third
  double withheld = 0;            // share of the force that is not paid for: the renderer's, or of a gain
  bool fades = false;             // the first or the second
  bool not_finite = false;        // what was rendered was no number: fault
  bool too_fast = false;          // the device runs away: fault
};

class ForceChain {
 public:
  explicit ForceChain(const ForceChainOptions& options);
  ForceChainOutput apply(const ForceChainInput& input) noexcept;
  // What the device last took, for the slew: the chain's own output unless the device was closed meanwhile.
  const Vector3& last_force_n() const noexcept { return last_force_n_; }
  // For the renderer's claims, before each apply().
  EnergyLedger& ledger() noexcept { return ledger_; }

 private:
  void observe(const ForceChainInput& input) noexcept;
  Vector3 wanted(const ForceChainInput& input, double indentation_m, double dt_s,
                 ForceChainOutput& output) noexcept;
  Vector3 fade(const ForceChainInput& input, double indentation_m, double dt_s) const noexcept;
  bool too_fast(const ForceChainInput& input) const noexcept;
  double largest_rise_n(const ForceChainInput& input, double indentation_m, double dt_s) const noexcept;
  void judge(const ForceChainInput& input, double dt_s, ForceChainOutput& output) noexcept;
  void settle_gain(const ForceChainInput& input, double indentation_m, double dt_s) noexcept;

  ForceChainOptions options_;
  EnergyLedger ledger_;
  double age_gain_ = 1;   // falls with the age, recovers slowly: answers that come in bursts do not shake
  double debt_gain_ = 1;  // 1: no energy is owed
  double clutch_gain_ = 1;
  // At the last tick; the second: silence, age, clutch and ramp together.
  double silence_gain_ = 0, gain_ = 0;
  EnergyClaim took_ = EnergyClaim::kRamp;  // which of them took most when last one did
  double gain_short_ = 0;                  // share of gain_ that waits to be paid for
  bool law_fades_ = false;                 // a law was felt since nothing faded last
  bool law_touched_ = false;               // and in this contact
  double share_ = 0;                       // of what the rendered model holds, as far as its force goes out
  double let_out_ = 1;                     // of what the gains leave of that, by the display's caps
  bool energy_generated_ = false;
  double withheld_s_ = 0;  // that much has been withheld for
  Vector3 last_force_n_ = Vector3::Zero();
  double last_indentation_m_ = 0;
  // Of the tick before; none when that was no number. The second is the hand's.
  std::optional<Vector3> last_position_m_, last_hand_m_;
};

}  // namespace teletact::client
