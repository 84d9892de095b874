// Virtual coupling for displays that command a position: they measure the hand's force and move where they
// are told (admittance displays). What moves them is a virtual tool between the hand and what is rendered,
//     m dv/dt = F_hand + F_rendered - b v,
// whose mass and damping bound the impedance from below, as the spring and damper of the coupling do from
// above on a display that commands a force (Adams and Hannaford 1999).
//
// At each tick the arm is where the tool was to be; the hand is felt there, the tissue was rendered for
// there, and both forces hold while the tool moves on: both springs, the tissue's K and the hand's k, act T/2
// late. With a hand that dissipates nothing itself the pair comes to rest when b > (K + k) T/2, (T5.1) for
// both. The hand's mass is felt late as well: a tool of less than half of it shakes, whatever its damping.
#pragma once

#include "client/render/renderer.h"

namespace teletact::client {

struct VirtualCouplingOptions {
  double mass_kg = 0.25;     // above any hand's (T5.7: .01 to .2 kg)
  double damping_n_s_m = 0;  // coupling_damping_n_s_m()
};

// For tissue of at most that stiffness and any hand of T5.7 (k up to 1000 N/m).
double coupling_damping_n_s_m(double tissue_n_m, double period_s) noexcept;

class VirtualCoupling {
 public:
  // The tool is at rest at `position_m`.
  VirtualCoupling(const VirtualCouplingOptions& options, const Vector3& position_m);
  // Moves the tool under two forces held for dt: exact. A force that is not finite counts as none.
  void step(const Vector3& hand_force_n, const Vector3& rendered_force_n, double dt_s) noexcept;
  const ToolPose& tool() const noexcept { return tool_; }  // what is rendered for, and where to move to

 private:
  VirtualCouplingOptions options_;
  ToolPose tool_;
};

}  // namespace teletact::client
