// Where the hand of a stability trial means to be: above the tissue until force is on; down; along at 120
// mm/s with rounded starts; and still.
#pragma once

#include "bench/stability/plant.h"
#include "bench/stability/trial.h"

namespace teletact::bench {

class HandPath {
 public:
  static constexpr double kHoverS = 0.6;  // at least
  static constexpr double kBeginM = 0.01;
  HandPath(const TrialOptions& options, double background_n_m);

  HandTarget at(double time_s) const;  // velocity: mean over the next servo period
  bool exploring(double time_s) const { return time_s >= begun_s_ && time_s < stopped_s_; }
  double stopped_s() const { return stopped_s_; }
  static Vector3 start_m() { return {kBeginM, -kHoverM, 0}; }

 private:
  static constexpr double kHoverM = 0.002, kApproachMS = 0.03, kSpeedMS = 0.12, kAccelerationMS2 = 2;
  static constexpr double kByDamper = 0.3;  // of the final force, by the damper while pressing
  static constexpr double kPressedS = 0.5;
  double depth(double time_s) const;
  double along(double time_s) const;

  double hover_s_;  // until answers come, and the start-up ramp is over
  double depth_m_;  // of the target: what the tissue's resistance takes is added
  double sweep_m_;
  double touched_s_, pressed_s_, begun_s_, stopped_s_;
};

}  // namespace teletact::bench
