// What a session sees of its device's adapter from beside the servo: calls that take long, and one that does
// not come back. The servo's thread can do nothing about that one; the device is told to let go from here.
#pragma once

#include <cstdint>
#include <string>

#include "client/haptic/haptic_device.h"
#include "client/servo/tick_watch.h"

namespace teletact::client {

class AdapterWatch {
 public:
  static constexpr double kSlowS = 0.005;  // a tick has 1 ms
  static constexpr double kEveryS = 5;     // from message to message

  // The message that is due at `now_s` (any clock that only goes forward), `ticks` ticks after the servo's
  // loop began; mostly empty.
  std::string message(HapticDevice& device, std::uint64_t ticks, double now_s);
  // The device has let go: the session is over.
  bool stuck() const noexcept { return stuck_; }

 private:
  TickWatch ticks_;
  double longest_s_ = 0, next_s_ = 0;
  bool stuck_ = false;
};

}  // namespace teletact::client
