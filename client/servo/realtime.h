// Real-time scheduling for the calling thread, where the system permits it.
#pragma once

#include <string>

namespace teletact::client {

struct RealTime {
  bool fifo = false;    // SCHED_FIFO
  bool locked = false;  // mlockall
  std::string text;     // one line: what was granted, and how to get what was not
};

// Never fails: without permission the loop runs all the same, with the jitter of a busy machine.
RealTime ask_for_real_time();

}  // namespace teletact::client
