// One trial of presses that go as deep as the device's largest force, and of what is left of it when the
// finger lifts: through the servo loop with its whole safety chain, on a clock of its own.
#pragma once

#include <string>

#include "bench/stability/tissue.h"
#include "bench/stability/trial.h"

namespace teletact::bench {

// That anybody presses; on the flank of an inclusion, where the force sideways grows with the square of it.
inline constexpr double kDeepestM = 0.025, kDeepestOnFlankM = 0.01;

// Pressed, held and lifted, twice; tapped at 3 Hz for a second; or, pressed on the middle of an inclusion,
// slid off it at up to 120 mm/s while it is held.
enum class LiftMotion { kLift, kTap, kSlide };
// By law: told from the beginning; or another one each 0.3 s, harder and softer by a third in turn, or none.
enum class LawTold { kOne, kChanging, kComingAndGoing };

struct LiftOptions {
  std::string renderer = "kalman";
  client::DeviceProfile device;
  bool damping_known = true;  // 0.5 N s/m; else the profile states none
  Scene scene = Scene::kHomogeneous;
  double stiffness_n_m = 500;  // largest of the scene
  double update_s = 0.002, model_delay_s = 0.003;
  double stall_s = 0;  // see RigOptions
  LawTold law = LawTold::kOne;
  LiftMotion motion = LiftMotion::kLift;
  double lift_m_s = 0.5;
  // The finger goes exactly where it is meant to; or a hand (T5.7) pulls it after it.
  const HandProfile* hand = nullptr;
};

struct LiftResult {
  double in_air_n = 0;  // largest force while the finger is above the surface by the device's resolution
  double largest_n = 0;
  double stored_j = 0;  // most that the display has held
  // In one contact: most that it has given back beyond what was put in, its own damping and friction left
  // out; and at most over what a force held between ticks gives in that motion: K T/2 v^2 over time, and half
  // of a step of the resolution. Where the renderer has no model the answer's age and period come to that
  // T/2.
  double given_j = 0, over_allowed = 0;
  // The same where what the device states to dissipate, or of one that states nothing a hand's least, 2 N
  // s/m, comes to what is put in: a harder model is paid for with it (T5.4b).
  double over_paid = 0;
  double min_ledger_j = 0;  // least that the ledgers had left
  double degraded_share = 0;  // of the ticks while ENABLED
  double damping_share = 0;   // of them: the passivity controller at work
  double enabled_share = 0;   // of the ticks after the start
};

LiftResult run_lift(const LiftOptions&);

}  // namespace teletact::bench
