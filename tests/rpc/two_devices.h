// Two halves of the machine's device stand in for two; where it cannot be cut (one core, most GPUs), it is
// opened twice.
#pragma once

#include <vector>

#include "service/device/device.h"
#include "tests/rpc/running_server.h"

namespace teletact::service {

inline std::vector<DeviceOptions> two_devices() {
  rpc_device();  // the first to use OpenCL: its niceness is everybody's
  try {
    const auto halves = choose_devices({"0/2"}, {});
    for (const DeviceOptions& half : halves) Device::open(half);
    return halves;
  } catch (const DeviceError&) {
    std::vector<DeviceOptions> twice(2);
    twice[1].number = 1;
    return twice;
  }
}

}  // namespace teletact::service
