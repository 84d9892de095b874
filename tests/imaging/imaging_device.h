// One opened device for all tests of this binary: opening and compiling costs more than the tests.
#pragma once

#include <memory>

#include "service/device/device.h"

namespace teletact::service {

inline const std::shared_ptr<Device>& imaging_device() {
  static const std::shared_ptr<Device> device = Device::open();
  return device;
}

}  // namespace teletact::service
