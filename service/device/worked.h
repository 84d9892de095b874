#pragma once

#include <chrono>

#include "service/device/cancellation.h"

namespace teletact::service {

// Seconds of the thread's own work, from any moment: while its looks wait it stands still.
inline double worked_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count() -
         waited_s();
}

}  // namespace teletact::service
