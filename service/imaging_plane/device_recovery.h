// A device that fails, and how it comes back: the imaging plane says so, the device is opened anew and warmed
// until that works, and then everything new uses the new one. Answers from compliances go on meanwhile.
#pragma once

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

namespace teletact::service {

// How long a device that failed is left alone before it is opened anew: twice as long each time, the first
// pause too when it had worked for less than the longest.
//
// Pure: time is an argument. One thread.
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

class DeviceRecovery {
 public:
  // `number` is said in the log. `again` opens the device anew, tries it and puts it into use, or throws.
  // `tell` is told each change of whether the device works. Both are called on a thread of its own.
  DeviceRecovery(std::size_t number, std::function<void()> again, std::function<void(bool works)> tell,
                 const RecoveryPauses& = RecoveryPauses());
  ~DeviceRecovery();  // stops
  DeviceRecovery(const DeviceRecovery&) = delete;
  DeviceRecovery& operator=(const DeviceRecovery&) = delete;
  // Waits for a try that is under way; nobody is told anything after it.
  void stop();
  // What failed; returns at once.
  void failed(const std::string& why);
  // Throws Error(kUnavailable) with the remedy while the device does not work.
  void require() const;
  bool works() const;

 private:
  void recover();
  const std::size_t number_;
  const std::function<void()> again_;
  const std::function<void(bool)> tell_;
  RecoveryPauses pauses_;  // of recover()
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::string why_;  // empty: it works
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace teletact::service
