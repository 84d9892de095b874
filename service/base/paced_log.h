// Lines of the log that a flood of events must not fill: one a pace at most, with how many were left out.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
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
class PacedLog {
 public:
  using Clock = std::chrono::steady_clock;

  explicit PacedLog(const char* event, Clock::duration pace = std::chrono::seconds(1))
      : event_(event), pace_(pace) {}
  // "event=EVENT WHAT left_out=N", N of them since the line before; `what()` gives the key=value pairs. None
  // within the pace of the line before, nor where what() throws.
  void tell(Clock::time_point now, const std::function<std::string()>& what) noexcept;
  // One of which nobody will tell.
  void leave_out() {
    const std::lock_guard lock(mutex_);
    ++left_out_;
  }

 private:
  // Those left out, where a line is due.
  std::optional<std::uint64_t> turn(Clock::time_point now);
  const char* const event_;
  const Clock::duration pace_;
  std::mutex mutex_;
  std::optional<Clock::time_point> said_at_;
  std::uint64_t left_out_ = 0;
};

// Of what took too long.
class SlowLog : public PacedLog {
 public:
  SlowLog(const char* event, Clock::duration max, Clock::duration pace) : PacedLog(event, pace), max_(max) {}
  bool too_long(Clock::duration took) const { return took > max_; }

 private:
  const Clock::duration max_;
};

}  // namespace teletact::service
