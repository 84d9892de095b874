// Time, injected: the servo and its tests differ in nothing else.
#pragma once

#include <cmath>
#include <cstdint>

namespace teletact::client {

std::int64_t monotonic_ns() noexcept;  // CLOCK_MONOTONIC

inline double seconds(std::int64_t ns) noexcept {
  return 1e-9 * static_cast<double>(ns);
}

inline std::int64_t to_ns(double seconds) noexcept {
  return std::llround(1e9 * seconds);
}

// Of any two stamps: those of a file or a peer may be further apart than an int64 holds.
inline double seconds_between(std::int64_t from_ns, std::int64_t to_ns) noexcept {
  return 1e-9 * static_cast<double>(static_cast<__int128>(to_ns) - from_ns);
}

class Clock {
 public:
  virtual ~Clock() = default;
  virtual std::int64_t now_ns() noexcept = 0;
  virtual void sleep_until_ns(std::int64_t time_ns) noexcept = 0;
};

// CLOCK_MONOTONIC, absolute-time sleep.
class MonotonicClock final : public Clock {
 public:
  std::int64_t now_ns() noexcept override { return monotonic_ns(); }
  void sleep_until_ns(std::int64_t time_ns) noexcept override;
};

// Moves only when told to; sleeping jumps to the end of the sleep, plus `wake_late_ns`.
class ManualClock final : public Clock {
 public:
  std::int64_t now_ns() noexcept override { return time_ns; }
  void sleep_until_ns(std::int64_t until_ns) noexcept override {
    if (until_ns > time_ns) time_ns = until_ns;
    time_ns += wake_late_ns;
  }
  std::int64_t time_ns = 1'000'000'000;
  std::int64_t wake_late_ns = 0;
};

}  // namespace teletact::client
