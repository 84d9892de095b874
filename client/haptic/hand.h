// A person's hand on the device: a point mass pulled by a spring and a damper towards where the person means
// it to be (T5.7: fingertip and hand m .01-.2 kg, b 2-10 N s/m, k 200-1000 N/m).
//
// Intent: hover above the tissue until force is on; press; sweep to and fro at constant speed with rounded
// turnarounds; regulate the depth slowly (a person feels how deep the finger is and corrects over half a
// second, so the mean indentation is what was asked for and an inclusion still lifts the finger). When force
// goes, lift; out of contact, ask for it again. It presses along y; its way is a line along x or z, or
// circles around a point that goes along one. At the border of what is covered the hand slows down, stops and
// waits until it grows: all of that time counts as held.
#pragma once

#include <atomic>

#include "client/haptic/haptic_device.h"

namespace teletact::client {

struct HandOptions {
  double mass_kg = 0.1;
  double damping_n_s_m = 5;
  double stiffness_n_m = 500;
  double indentation_m = 0.004;
  double speed_m_s = 0.12;
  double begin_m = 0;  // sweeps between these, along its line
  double end_m = 0.06;
  double start_m = 0;              // presses down first here, then sweeps towards `end_m`
  bool along_z = false;            // the line lies along z; else along x
  double across_m = 0;             // where it lies: its z; along z its x
  double circle_radius_m = 0;      // of circles about a point that goes on by this in each turn; 0: straight
  double acceleration_m_s2 = 2.0;  // turnarounds and stops
  double approach_m_s = 0.03;      // pressing and lifting
  double hover_m = 0.005;          // height above the surface when not pressing
  double border_m = 0.001;         // the hand stays this far inside of what is covered
  double depth_gain_1_s = 2.0;     // of the depth regulation
};

class Hand {
 public:
  // Starts at `start_m` of its way, hovering over y = 0.
  explicit Hand(const HandOptions& options);

  // Moves the intent on by dt under what the operator sees and feels.
  void intend(const OperatorView& view, const Vector3& position_m, double dt_s) noexcept;
  // Force of the hand on the device.
  Vector3 force(const Vector3& position_m, const Vector3& velocity_m_s) const noexcept;

  const HandOptions& options() const noexcept { return options_; }
  const Vector3& target_m() const noexcept { return target_m_; }
  bool held_at_border() const noexcept { return held_; }
  bool resume_pressed() const noexcept { return resume_; }
  // Sweeps ended, from one end to the other. May be read from any thread.
  unsigned passes() const noexcept { return passes_.load(std::memory_order_relaxed); }

 private:
  enum class Phase { kHover, kPress, kSweep };
  void press(const OperatorView& view, double indentation_m, double dt_s) noexcept;
  void sweep(const OperatorView& view, double dt_s) noexcept;
  void go_to(double along_m) noexcept;
  // Of the way, by the metre along its line: [x, 0, z].
  Vector3 forward() const noexcept;

  HandOptions options_;
  Phase phase_ = Phase::kHover;
  Vector3 target_m_ = Vector3::Zero();
  Vector3 target_velocity_m_s_ = Vector3::Zero();
  double correction_m_ = 0;  // of the depth
  double along_m_ = 0;       // where on its line the way is
  double direction_ = 1;
  double speed_m_s_ = 0;
  bool held_ = false;
  bool resume_ = false;
  double asking_s_ = 0;  // for force, so far
  std::atomic<unsigned> passes_{0};
};

}  // namespace teletact::client
