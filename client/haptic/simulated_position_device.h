// A simulated display that commands a position, with a hand on it: a stiff arm that is a servo period later
// where it is told to be, moving straight, and a force sensor under the hand (its pull less the inertia of
// its mass). The force written acts on the virtual tool of the coupling, whose next place the arm is told.
#pragma once

#include <cstdint>

#include "client/haptic/elapsed_time.h"
#include "client/haptic/hand.h"
#include "client/haptic/haptic_device.h"
#include "client/haptic/virtual_coupling.h"

namespace teletact::client {

struct SimulatedPositionDeviceOptions {
  DeviceProfile profile;
  HandOptions hand;
  double tool_mass_kg = VirtualCouplingOptions().mass_kg;
  // Of the damping that the profile's stiffness needs; less than 1 is for tests.
  double damping_share = 1;
  double period_s = 0.001;     // of the servo
  double longest_gap_s = 0.1;  // time the simulation makes up for after the servo slept
};

class SimulatedPositionDevice final : public HapticDevice {
 public:
  explicit SimulatedPositionDevice(const SimulatedPositionDeviceOptions& options);
  // Its own friction, none, and damping; not those of the device that it is named after.
  const DeviceProfile& profile() const noexcept override { return options_.profile; }
  void open() override;
  void close() noexcept override { open_ = false; }
  // The pose that the virtual tool, and so the arm, has at the end of this period.
  bool read(std::int64_t now_ns, DeviceReading& reading) noexcept override;
  bool write(const Vector3& force_n) noexcept override;
  void show(const OperatorView& view) noexcept override { view_ = view; }
  unsigned passes() const noexcept override { return hand_.passes(); }

  // For tests. Where the arm is; and the work of the hand on it since open(): less than zero is energy that
  // the display has generated.
  const ToolPose& arm() const noexcept { return arm_; }
  double hand_work_j() const noexcept { return hand_work_j_; }

 private:
  double damping_n_s_m() const;  // of the coupling
  VirtualCoupling coupling() const;
  void move(double dt_s) noexcept;

  SimulatedPositionDeviceOptions options_;
  Hand hand_;
  VirtualCoupling coupling_;
  OperatorView view_;
  ToolPose arm_;
  Vector3 hand_force_n_ = Vector3::Zero();
  Vector3 force_n_ = Vector3::Zero();
  double hand_work_j_ = 0;
  ElapsedTime elapsed_;
  bool open_ = false;
};

}  // namespace teletact::client
