// Device and hand as one point mass, integrated exactly between servo ticks:
//     m x'' = -b x' - k_h (x - r) - b_h (x' - r') + F - f_c x'/|x'|,
// the display's force F held, the hand's target r moving straight, Coulomb friction along the motion at the
// start of the step. A mass that turns within a step is stopped where it would turn; one at rest stays until
// the other forces exceed f_c.
#pragma once

#include <Eigen/Core>

#include "client/render/renderer.h"

namespace teletact::bench {

using client::Vector3;

struct PlantOptions {
  double mass_kg = 0.15;       // device and hand
  double damping_n_s_m = 0.5;  // of the display
  double friction_n = 0;
  double hand_stiffness_n_m = 500;
  double hand_damping_n_s_m = 5;
  double step_s = 0.001;
};

struct HandTarget {
  Vector3 position_m = Vector3::Zero();  // at the start of the step
  Vector3 velocity_m_s = Vector3::Zero();
};

class Plant {
 public:
  Plant(const PlantOptions& options, const Vector3& position_m);
  // One step under `force_n` on the finger.
  void step(const Vector3& force_n, const HandTarget& target) noexcept;

  const Vector3& position_m() const noexcept { return position_m_; }
  const Vector3& velocity_m_s() const noexcept { return velocity_m_s_; }
  // Since the start: what the hand has put into the display less what it got back, the display's own damping
  // and friction being parts of the display: Int (b v^2 + f_c |v| - F v) dt. Less than zero: energy was
  // generated.
  double port_energy_j() const noexcept { return port_energy_j_; }

 private:
  PlantOptions options_;
  Eigen::Matrix2d whole_, half_;  // [distance from equilibrium, velocity] over a step and half of one
  Vector3 position_m_;
  Vector3 velocity_m_s_ = Vector3::Zero();
  double port_energy_j_ = 0;
};

}  // namespace teletact::bench
