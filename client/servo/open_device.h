// A device that is open for as long as this lives, and lets go if the process ends sooner.
#pragma once

#include "client/haptic/haptic_device.h"
#include "client/servo/ending.h"

namespace teletact::client {

class OpenDevice {
 public:
  // Throws as HapticDevice::open().
  explicit OpenDevice(HapticDevice& device)
      : device_((device.open(), device)),
        last_act_([](void* of) noexcept { static_cast<HapticDevice*>(of)->let_go(); }, &device) {}
  ~OpenDevice() { device_.close(); }
  OpenDevice(const OpenDevice&) = delete;
  OpenDevice& operator=(const OpenDevice&) = delete;

 private:
  HapticDevice& device_;
  LastAct last_act_;
};

}  // namespace teletact::client
