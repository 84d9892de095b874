// One work-item a node, in groups of what the kernels of this folder call WORK_GROUP.
#pragma once

#include <cstddef>

#include "service/device/device.h"

namespace teletact::service {

inline constexpr std::size_t kGroup = 32;

inline Range over(int nodes) {
  return {{static_cast<std::size_t>(nodes), 1, 1}, {kGroup, 1, 1}};
}

}  // namespace teletact::service
