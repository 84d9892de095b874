#include "client/haptic/simulated_position_device.h"

#include <algorithm>
#include <cmath>

namespace teletact::client {

SimulatedPositionDevice::SimulatedPositionDevice(const SimulatedPositionDeviceOptions& options)
    : options_(options), hand_(options.hand), coupling_(coupling()), elapsed_(options.longest_gap_s) {
  // Nothing rubs, a position is commanded. The tool is damped: what the hand's stiffness does not need of
  // that, which is felt a period late, dissipates as a mechanism's damping does.
  options_.profile.friction_n = 0;
  options_.profile.damping_n_s_m =
      std::max(damping_n_s_m() - coupling_damping_n_s_m(0, options.period_s), 0.0);
}

double SimulatedPositionDevice::damping_n_s_m() const {
  return options_.damping_share *
         coupling_damping_n_s_m(options_.profile.largest_stiffness_n_m, options_.period_s);
}

VirtualCoupling SimulatedPositionDevice::coupling() const {
  return {{.mass_kg = options_.tool_mass_kg, .damping_n_s_m = damping_n_s_m()}, hand_.target_m()};
}

void SimulatedPositionDevice::open() {
  coupling_ = coupling();
  arm_ = coupling_.tool();
  hand_force_n_.setZero();
  force_n_.setZero();
  hand_work_j_ = 0;
  open_ = true;
  elapsed_.restart();
}

// One servo period: the arm goes where it was told, the hand is felt there, the tool moves on.
void SimulatedPositionDevice::move(double dt_s) noexcept {
  const Vector3 way_m = coupling_.tool().position_m - arm_.position_m;
  const Vector3 velocity_m_s = way_m / dt_s;
  hand_.intend(view_, arm_.position_m, dt_s);
  const Vector3 inertia_n = options_.hand.mass_kg * (velocity_m_s - arm_.velocity_m_s) / dt_s;
  arm_ = {coupling_.tool().position_m, velocity_m_s};
  const Vector3 felt_n = hand_.force(arm_.position_m, velocity_m_s) - inertia_n;
  hand_work_j_ += (felt_n + hand_force_n_).dot(way_m) / 2;
  hand_force_n_ = felt_n;
  coupling_.step(felt_n, force_n_, dt_s);
}

bool SimulatedPositionDevice::read(std::int64_t now_ns, DeviceReading& reading) noexcept {
  if (!open_) return false;
  const double elapsed_s = elapsed_.since_last_s(now_ns);
  const auto periods = static_cast<int>(std::ceil(elapsed_s / options_.period_s - 0.5));
  for (int period = 0; period < periods; ++period) move(elapsed_s / periods);
  reading.pose = coupling_.tool();
  reading.held_at_border = hand_.held_at_border();
  reading.resume_pressed = hand_.resume_pressed();
  return true;
}

bool SimulatedPositionDevice::write(const Vector3& force_n) noexcept {
  if (!open_ || !force_n.allFinite()) return false;
  force_n_ = cap_magnitude(force_n, options_.profile.largest_force_n);
  return true;
}

}  // namespace teletact::client
