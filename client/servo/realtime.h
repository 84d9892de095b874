// Real-time scheduling for the calling thread, where the system permits it.
#pragma once

#include <string>

namespace teletact::client {

// Above ordinary threads, below the kernel's own interrupt threads (50). The link comes after the servo.
inline constexpr int kServoPriority = 40, kLinkPriority = 30;

// SCHED_FIFO for the calling thread, not for threads that it starts. Returns 0 or the errno of the refusal.
int ask_for_fifo(int priority) noexcept;

struct RealTime {
  bool fifo = false;    // SCHED_FIFO
  bool locked = false;  // mlockall
  std::string text;     // one line: what was granted, and how to get what was not
};

// For the servo thread. Never fails: without permission the loop runs all the same, with the jitter of a busy
// machine.
RealTime ask_for_real_time();

}  // namespace teletact::client
