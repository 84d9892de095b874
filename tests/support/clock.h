// The clock of recordings.
#pragma once

#include <chrono>

namespace teletact::test {

// CLOCK_MONOTONIC.
inline double now_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace teletact::test
