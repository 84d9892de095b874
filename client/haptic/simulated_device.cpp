#include "client/haptic/simulated_device.h"

#include <algorithm>
#include <cmath>

namespace teletact::client {

SimulatedDevice::SimulatedDevice(const SimulatedDeviceOptions& options)
    : options_(options),
      hand_(options.hand),
      read_(options.profile.resolution_m, options.velocity_filter_s),
      elapsed_(options.longest_gap_s) {
  options_.profile.damping_n_s_m = options.damping_n_s_m;
}

void SimulatedDevice::open() {
  exact_ = ToolPose{hand_.target_m(), Vector3::Zero()};
  read_.restart(exact_.position_m);
  force_n_.setZero();
  open_ = true;
  elapsed_.restart();
}

void SimulatedDevice::close() noexcept {
  force_n_.setZero();
  open_ = false;
}

double SimulatedDevice::kinetic_energy_j() const noexcept {
  const double mass_kg = options_.profile.apparent_mass_kg + options_.hand.mass_kg;
  return 0.5 * mass_kg * exact_.velocity_m_s.squaredNorm();
}

// One sub-step: m dv/dt = F_hand + F_device - b v - F_friction; friction stops the mass rather than turning
// it.
void SimulatedDevice::integrate(double dt_s) noexcept {
  const double mass_kg = options_.profile.apparent_mass_kg + options_.hand.mass_kg;
  const Vector3 force_n = hand_.force(exact_.position_m, exact_.velocity_m_s) + force_n_ -
                          options_.damping_n_s_m * exact_.velocity_m_s;
  Vector3 velocity_m_s = exact_.velocity_m_s + dt_s / mass_kg * force_n;
  const double friction_m_s = dt_s / mass_kg * options_.profile.friction_n;
  const double speed_m_s = velocity_m_s.norm();
  velocity_m_s *= speed_m_s > friction_m_s ? 1 - friction_m_s / speed_m_s : 0.0;
  exact_.velocity_m_s = velocity_m_s;
  exact_.position_m += dt_s * velocity_m_s;
}

bool SimulatedDevice::read(std::int64_t now_ns, DeviceReading& reading) noexcept {
  if (!open_) return false;
  const double elapsed_s = elapsed_.since_last_s(now_ns);
  if (elapsed_s > 0) {
    const int steps = std::max(1, static_cast<int>(std::lround(elapsed_s / options_.substep_s)));
    const double dt_s = elapsed_s / steps;
    for (int step = 0; step < steps; ++step) {
      hand_.intend(view_, exact_.position_m, dt_s);
      integrate(dt_s);
    }
    read_.take(exact_.position_m, elapsed_s);
  }
  reading.pose = read_.pose();
  reading.held_at_border = hand_.held_at_border();
  reading.resume_pressed = hand_.resume_pressed();
  return true;
}

bool SimulatedDevice::write(const Vector3& force_n) noexcept {
  if (!open_ || !force_n.allFinite()) return false;
  force_n_ = cap_magnitude(force_n, options_.profile.largest_force_n);
  return true;
}

}  // namespace teletact::client
