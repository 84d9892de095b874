// Two halves of the machine's device stand in for two.
#pragma once

#include <vector>

#include "service/device/device.h"
#include "tests/rpc/running_server.h"

namespace teletact::service {

inline std::vector<DeviceOptions> two_devices() {
  rpc_device();  // the first to use OpenCL: its niceness is everybody's
  const DeviceInfo whole = list_devices().front();
  if (!whole.gpu && whole.compute_units > 1) return choose_devices({"0/2"}, {});
  std::vector<DeviceOptions> twice(2);  // on one core, or a GPU: most cannot be cut
  twice[1].number = 1;
  return twice;
}

}  // namespace teletact::service
