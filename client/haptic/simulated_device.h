// A simulated haptic device with a hand on it: one point mass (device and hand), the hand's pull, the
// device's damping and Coulomb friction, the force written (held between ticks, limited to what the device
// can do), and a position read with the device's resolution. Semi-implicit Euler at sub-steps of the servo
// period.
//
// Travel is 1:1 with the scene; a scene wider than the real device's workspace is allowed here (workspace
// clutching is not simulated).
#pragma once

#include <cstdint>

#include "client/haptic/elapsed_time.h"
#include "client/haptic/hand.h"
#include "client/haptic/haptic_device.h"
#include "client/haptic/quantised_reading.h"

namespace teletact::client {

struct SimulatedDeviceOptions {
  DeviceProfile profile;
  HandOptions hand;
  double damping_n_s_m = 0.5;  // of the mechanism; its profile says so
  double substep_s = 5e-5;
  double velocity_filter_s = 0.002;  // of the velocity estimated from quantised positions
  double longest_gap_s = 0.1;        // time the simulation makes up for after the servo slept
};

class SimulatedDevice final : public HapticDevice {
 public:
  explicit SimulatedDevice(const SimulatedDeviceOptions& options);
  const DeviceProfile& profile() const noexcept override { return options_.profile; }
  void open() override;
  void close() noexcept override;
  bool read(std::int64_t now_ns, DeviceReading& reading) noexcept override;
  bool write(const Vector3& force_n) noexcept override;
  void show(const OperatorView& view) noexcept override { view_ = view; }

  unsigned passes() const noexcept override { return hand_.passes(); }

  const Hand& hand() const noexcept { return hand_; }
  // Exact state, for tests: the reading is quantised and filtered.
  const ToolPose& exact() const noexcept { return exact_; }
  double kinetic_energy_j() const noexcept;

 private:
  void integrate(double dt_s) noexcept;

  SimulatedDeviceOptions options_;
  Hand hand_;
  OperatorView view_;
  ToolPose exact_;
  QuantisedReading read_;
  Vector3 force_n_ = Vector3::Zero();
  ElapsedTime elapsed_;
  bool open_ = false;
};

}  // namespace teletact::client
