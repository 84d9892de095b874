#include "client/haptic/profiles.h"

#include <algorithm>
#include <stdexcept>

namespace teletact::client {

double DeviceProfile::largest_slew_n_s() const {
  constexpr double kFullScalePerS = 12;
  constexpr double kFingerMS = 0.15;
  return std::max(kFullScalePerS * largest_force_n, kFingerMS * metres_per_hand_m * largest_stiffness_n_m);
}

ForceLimits DeviceProfile::limits() const {
  ForceLimits limits;
  limits.largest_force_n = largest_force_n;
  limits.largest_stiffness_n_m = largest_stiffness_n_m;
  limits.largest_damping_n_s_m = largest_damping_n_s_m;
  limits.largest_slew_n_s = largest_slew_n_s();
  limits.friction_n = friction_n;
  limits.damping_n_s_m = damping_n_s_m;
  limits.largest_speed_m_s *= metres_per_hand_m;
  limits.hand_n_s_m *= joules_per_hand_j / (metres_per_hand_m * metres_per_hand_m);
  limits.joules_per_hand_j = joules_per_hand_j;
  return limits;
}

const std::vector<DeviceProfile>& device_profiles() {
  static const std::vector<DeviceProfile> profiles = {
      // name, N, N/m, N s/m, workspace m, kg, N, m, N s/m
      {"premium-1.5", 8.5, 800, 5, 0.12, 0.075, 0.04, 0.03e-3, 0},
      {"premium-3.0", 22, 1000, 5, 0.25, 0.159, 0.2, 0.02e-3, 0},
      {"omni", 3.3, 700, 5, 0.10, 0.045, 0.26, 0.055e-3, 0},
      {"touch", 3.3, 400, 4, 0.075, 0.045, 0.26, 0.055e-3, 0},
  };
  return profiles;
}

const DeviceProfile& device_profile(std::string_view name) {
  std::string known;
  for (const DeviceProfile& profile : device_profiles()) {
    if (profile.name == name) return profile;
    known += (known.empty() ? "" : ", ") + profile.name;
  }
  throw std::invalid_argument("unknown device profile '" + std::string(name) + "'; known: " + known);
}

}  // namespace teletact::client
