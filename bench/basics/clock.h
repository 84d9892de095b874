// The clock that everything here is timed by.
#pragma once

#include <chrono>
#include <ctime>

namespace teletact::bench {

using Clock = std::chrono::steady_clock;

inline double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

inline double seconds_of(auto&& work) {
  const Clock::time_point begin = Clock::now();
  work();
  return seconds_since(begin);
}

// Processor time of this thread: what work of one thread takes on a machine that others load. Of all threads
// of the process: CLOCK_PROCESS_CPUTIME_ID.
inline double processor_seconds_of(auto&& work, clockid_t clock = CLOCK_THREAD_CPUTIME_ID) {
  const auto now = [clock] {
    timespec t{};
    clock_gettime(clock, &t);
    return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
  };
  const double begin = now();
  work();
  return now() - begin;
}

}  // namespace teletact::bench
