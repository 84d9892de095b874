// Devices by name (T5.7). Force, stiffness, damping and workspace are T5.7's; apparent mass, friction and
// resolution of those that T5.7 does not list are the makers' data sheets'.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "client/render/force_limits.h"

namespace teletact::client {

struct DeviceProfile {
  std::string name;
  double largest_force_n = 0;
  double largest_stiffness_n_m = 0;
  double largest_damping_n_s_m = 0;
  double workspace_radius_m = 0;
  double apparent_mass_kg = 0;
  double friction_n = 0;
  double resolution_m = 0;
  // Viscous, of the mechanism, that is surely there: the passivity controller counts on it. 0 where it is not
  // known: neither (T5.7) nor the makers' data sheets state it, and a simulated device states its own.
  double damping_n_s_m = 0;
  // Of these figures per metre and joule at the hand: not 1 where a workspace map lies between.
  double metres_per_hand_m = 1, joules_per_hand_j = 1;
  // Enough for full-scale silence to fade in its 100 ms, and for the stiffest wall under a finger at 150
  // mm/s; no more, since whatever goes wrong reaches the hand at this rate.
  double largest_slew_n_s() const;
  ForceLimits limits() const;
};

const std::vector<DeviceProfile>& device_profiles();
// Throws std::invalid_argument listing the known names.
const DeviceProfile& device_profile(std::string_view name);

}  // namespace teletact::client
