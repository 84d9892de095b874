// Haptic devices by what a person writes behind --device.
#pragma once

#include <memory>
#include <string>

#include "client/haptic/hand.h"
#include "client/haptic/haptic_device.h"
#include "client/haptic/workspace.h"

namespace teletact::client {

struct DeviceChoice {
  // simulated | simulated-position | plugin:FILE[,SETTINGS] | inverse3[:URL] | replay:FILE
  std::string device = "simulated";
  std::string profile = "premium-1.5";  // of a simulated or a replayed device
  HandOptions hand =
      {};  // the simulated hand; other devices start above its start_m, across_m, hover_m over the surface
  WorkspaceOptions workspace = {};  // of a real device
};

// Plugins and the Inverse3: a person's hand moves it.
bool is_real(const std::string& device);

// Not opened yet. Throws std::invalid_argument or std::runtime_error with one line: an unknown device or
// profile, a file that is missing or is not what it should be.
std::unique_ptr<HapticDevice> make_device(const DeviceChoice& choice);
// Of a device that is_real() alone.
std::unique_ptr<WorkspaceDevice> make_real_device(const DeviceChoice& choice);

}  // namespace teletact::client
