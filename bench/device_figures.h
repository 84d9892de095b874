// Which device figures are of.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "service/device/device.h"

namespace teletact::bench {

struct DeviceFigures {
  std::string name, driver_version;
  std::size_t compute_units = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(DeviceFigures, name, driver_version, compute_units)

inline DeviceFigures describe(const service::DeviceInfo& info) {
  return {info.name, info.driver_version, info.compute_units};
}

}  // namespace teletact::bench
