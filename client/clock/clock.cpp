#include "client/clock/clock.h"

#include <time.h>

#include <cerrno>

namespace teletact::client {
namespace {

constexpr std::int64_t kNsPerS = 1'000'000'000;

}  // namespace

std::int64_t monotonic_ns() noexcept {
  timespec time{};
  clock_gettime(CLOCK_MONOTONIC, &time);
  return time.tv_sec * kNsPerS + time.tv_nsec;
}

void MonotonicClock::sleep_until_ns(std::int64_t time_ns) noexcept {
  const timespec until{.tv_sec = time_ns / kNsPerS, .tv_nsec = time_ns % kNsPerS};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
  }
}

}  // namespace teletact::client
