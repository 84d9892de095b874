// Where a finger is that goes to and fro.
#pragma once

#include <cmath>

namespace teletact::bench {

// At `time_s`, at `speed_m_s` between `begin_m` and `end_m`; every client is elsewhere on the way.
inline double sweep_m(double begin_m, double end_m, double speed_m_s, unsigned client, double time_s) {
  const double width = end_m - begin_m;
  const double way = std::fmod(speed_m_s * std::abs(time_s) + 0.37 * width * client, 2 * width);
  return begin_m + (way < width ? way : 2 * width - way);
}

}  // namespace teletact::bench
