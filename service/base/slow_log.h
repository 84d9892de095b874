// What took too long, as lines of the log: one a pace at most, so that a flood of them does not fill it.
#pragma once

#include <spdlog/spdlog.h>

#include <chrono>
#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

namespace teletact::service {

struct StageTime {
  const char* name;
  std::chrono::steady_clock::duration took;
};

// "took_s=1.2345 upload_s=0.2000 ...".
std::string key_values(std::chrono::steady_clock::duration took, const std::vector<StageTime>& stages);

// Thread-safe.
class SlowLog {
 public:
  using Clock = std::chrono::steady_clock;

  SlowLog(const char* event, Clock::duration most, Clock::duration pace)
      : event_(event), max_(most), pace_(pace) {}
  bool too_long(Clock::duration took) const { return took > max_; }
  // "event=EVENT WHAT left_out=N", N of them since the line before; `what()` gives the key=value pairs. None
  // within the pace of the line before, nor where what() throws.
  template <class What>
  void tell(Clock::time_point now, What&& what) noexcept {
    try {
      if (const auto left_out = turn(now)) spdlog::warn("event={} {} left_out={}", event_, what(), *left_out);
    } catch (...) {
    }
  }
  // One of which nobody will tell.
  void leave_out() {
    const std::lock_guard lock(mutex_);
    ++left_out_;
  }

 private:
  // Those left out, where a line is due.
  std::optional<std::uint64_t> turn(Clock::time_point now);
  const char* const event_;
  const Clock::duration max_, pace_;
  std::mutex mutex_;
  std::optional<Clock::time_point> said_at_;
  std::uint64_t left_out_ = 0;
};

}  // namespace teletact::service
