// A mailbox of one slot between a thread that brings values and one that works on them: the newest value
// wins, a value that was not taken in time is gone. Never blocks the bringer.
#pragma once

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <utility>

namespace teletact::service {

template <class T>
class Mailbox {
 public:
  using Clock = std::chrono::steady_clock;

  // Puts `value` in the slot, over an older one. Returns whether an older one was lost.
  bool put(T value) {
    bool lost = false;
    {
      const std::lock_guard lock(mutex_);
      lost = slot_.has_value();
      slot_ = std::move(value);
    }
    changed_.notify_one();
    return lost;
  }

  // Lets the waiter look at its condition again. Call after changing what the condition reads.
  void wake() {
    { const std::lock_guard lock(mutex_); }  // the waiter is either before its check or asleep
    changed_.notify_one();
  }

  // Waits until `stop()` or until a value is there and `ready()`; empty when stopped or past `deadline`.
  // Both conditions are called under the mailbox's lock: they read atomics, nothing more.
  template <class Ready, class Stop>
  std::optional<T> take(Clock::time_point deadline, Ready ready, Stop stop) {
    std::unique_lock lock(mutex_);
    changed_.wait_until(lock, deadline, [&] { return stop() || (slot_.has_value() && ready()); });
    if (stop() || !slot_.has_value() || !ready()) return std::nullopt;
    return std::exchange(slot_, std::nullopt);
  }

  // Waits for `condition()` alone; false past `deadline`.
  template <class Condition>
  bool wait(Clock::time_point deadline, Condition condition) {
    std::unique_lock lock(mutex_);
    return changed_.wait_until(lock, deadline, condition);
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<T> slot_;
};

}  // namespace teletact::service
