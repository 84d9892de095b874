// One stability trial: a hand presses, explores at 120 mm/s and stops, on a display that renders tissue from
// answers which are late and few. Time is simulated; a second takes about a millisecond.
#pragma once

#include <string>
#include <vector>

#include "bench/stability/plant.h"
#include "bench/stability/rest.h"
#include "bench/stability/tissue.h"
#include "client/haptic/profiles.h"

namespace teletact::bench {

// Mass, stiffness and damping of a hand (T5.7).
struct HandProfile {
  const char* name;
  double mass_kg, damping_n_s_m, stiffness_n_m;
};
// Its middle and corners, the middle first; one by its name. Throws std::out_of_range for another name.
const std::vector<HandProfile>& hands();
const HandProfile& hand(const std::string& name);

// A display without mass of its own, friction, resolution or limits: the servo alone bounds it.
client::DeviceProfile ideal_display();

struct TrialOptions {
  std::string renderer = "kalman";
  client::DeviceProfile device = ideal_display();
  double damping_n_s_m = 0.5;  // of the display
  bool damping_known = true;   // its profile states it; else 0, as for a device whose maker does not
  HandProfile hand = hands().front();
  Scene scene = Scene::kHomogeneous;
  double stiffness_n_m = 500;    // largest of the scene
  double update_s = 0.02;        // between answers
  double model_delay_s = 0;      // from a pose to its answer
  double force_delay_s = 0;      // from the renderer to the device
  double indentation_m = 0.003;  // that the hand goes for
  double sweep_m = 0.1;          // explored at 120 mm/s; 0: pressed alone
  double rest_s = 1;             // at the end, watched, at least; see rest.h
  bool foreseen = true;          // false: answers out of contact do not tell what waits below the finger
  double stall_s = 0;            // see RigOptions
  // By law: told from the beginning, of the tissue up to here.
  double law_end_m = 0.124;
  bool safe = false;  // through the servo loop with its whole safety chain
};

struct TrialResult {
  Verdict verdict = Verdict::kStable;
  double swing_m = 0;      // peak to peak at the end of the rest, or how far off a hand was given up
  double generated_j = 0;  // most that the display, damping and friction included, has given in excess
  double stored_j = 0;     // most that it has held
  // Most that it has given since any moment, beyond what the true tissue gave back and its own damping and
  // friction took: over the most that the tissue held. Reserves of earlier dissipation do not hide it.
  double drawdown = 0;
  // RMS over the exploration in contact, over the RMS of the true force: of what was written, of the exact
  // contact law of the place that the newest answer is of, and of that answer's exact force and tangent.
  double force_error = 0, exact_law_error = 0, exact_tangent_error = 0;
  double degraded_share = 0;  // of the ticks while ENABLED
  double enabled_share = 0;   // of the ticks after the start
  double damping_share = 0;   // of the ticks: the passivity controller at work
  std::size_t ticks = 0;
  // By law, of the ticks in contact with force on and the finger below 150 mm/s: written within 0.5 % + 1 mN
  // and 1 % + 1 mN of the exact force at the place that was read; where the display's stiffness is not
  // enough, of the exact potential's (T7.3). Of all ticks in contact those that were faster.
  double within_half = 1, within_one = 1, fast_share = 0;
  // By law: most that the display has given since any moment, beyond what that potential gave back and what a
  // force held between ticks gives (K T/2 v^2 over time, half a step of the resolution), over the most that
  // the potential held. And the least that the ledgers had left.
  double given = 0, min_ledger_j = 0;
};

inline constexpr double kLawWithinCap = 0.6;  // of the display's stiffness: the soft minimum is not felt

TrialResult run_trial(const TrialOptions&);

}  // namespace teletact::bench
