// What a session sees of its device's adapter from beside the servo: calls that take long, and one that does
// not come back. The servo's thread can do nothing about that one; the device is told to let go from here.
#pragma once

#include <cstdint>
#include <string>

#include "client/haptic/haptic_device.h"

namespace teletact::client {

class AdapterWatch {
 public:
  static constexpr double kSlowS = 0.005;  // a tick has 1 ms
  static constexpr double kStuckS = 1;     // without a tick
  static constexpr double kEveryS = 5;     // from line to line

  // The line that is due at `now_s` (any clock that only goes forward), `ticks` ticks of the servo later;
  // mostly empty.
  std::string line(HapticDevice& device, std::uint64_t ticks, double now_s);
  // The device has let go: the session is over.
  bool stuck() const noexcept { return stuck_; }

 private:
  std::uint64_t ticks_ = 0;
  double ticked_s_ = 0;
  double longest_s_ = 0, next_s_ = 0;
  bool stuck_ = false;
};

}  // namespace teletact::client
