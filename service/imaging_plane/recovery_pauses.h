// How long a device that failed is left alone before it is opened anew: twice as long each time, the first
// pause too when it had worked for less than the longest.
//
// Pure: time is an argument. One thread.
#pragma once

#include <algorithm>
#include <chrono>
#include <optional>

namespace teletact::service {

class RecoveryPauses {
 public:
  using Clock = std::chrono::steady_clock;
  using Time = std::chrono::milliseconds;
  static constexpr Time kFirst{250}, kLongest{30'000};

  explicit RecoveryPauses(Time first = kFirst, Time longest = kLongest) : min_(first), longest_(longest) {}

  // Before the first try.
  Time failed(Clock::time_point now) {
    const bool at_once = worked_since_ && now - *worked_since_ < longest_;
    first_ = at_once ? twice(first_) : min_;
    return next_ = first_;
  }
  // Before the next one.
  Time failed_again() { return next_ = twice(next_); }
  void works(Clock::time_point now) { worked_since_ = now; }

 private:
  Time twice(Time pause) const { return std::min(2 * pause, longest_); }
  Time min_, longest_, first_ = min_, next_ = min_;
  std::optional<Clock::time_point> worked_since_;
};

}  // namespace teletact::service
