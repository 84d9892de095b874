// Real-time scheduling for the calling thread, where the system permits it.
#pragma once

#include <cstddef>
#include <string>

namespace teletact::client {

struct RealTime {
  bool fifo = false;    // SCHED_FIFO
  bool locked = false;  // all memory, or that of the loop
  std::string text;     // one line: what was granted, and how to get what was not
};

// Never fails: without permission the loop runs all the same, with the jitter of a busy machine. Where locked
// memory is limited, only the loop's `bytes` and the top of this thread's stack are locked: what is locked as
// a whole makes any later allocation fail that would exceed the limit.
RealTime ask_for_real_time(const void* loop, std::size_t bytes);

}  // namespace teletact::client
