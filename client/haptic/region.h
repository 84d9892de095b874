// A part of the touched layer.
#pragma once

#include <limits>

namespace teletact::client {

// [begin, end) both ways; a plane scene's has no ends along z.
struct Region {
  double begin_x_m = 0, end_x_m = 0;
  double begin_z_m = -std::numeric_limits<double>::infinity(),
         end_z_m = std::numeric_limits<double>::infinity();
};

}  // namespace teletact::client
