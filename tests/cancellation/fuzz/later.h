// Does things at given times, on one thread.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <map>
#include <mutex>
#include <thread>

namespace teletact::test {

class Later {
 public:
  using Clock = std::chrono::steady_clock;
  Later() : thread_([this] { run(); }) {}
  ~Later() {
    {
      const std::lock_guard lock(mutex_);
      stop_ = true;
    }
    changed_.notify_one();
    thread_.join();
  }
  void after(Clock::duration wait, std::function<void()> what) {
    {
      const std::lock_guard lock(mutex_);
      due_.emplace(Clock::now() + wait, std::move(what));
    }
    changed_.notify_one();
  }

 private:
  // What is still to come when it stops is done at once: calls wait for it.
  void run() {
    std::unique_lock lock(mutex_);
    while (!stop_ || !due_.empty()) {
      if (due_.empty()) {
        changed_.wait(lock);
      } else if (const auto next = due_.begin(); !stop_ && next->first > Clock::now()) {
        changed_.wait_until(lock, Clock::time_point(next->first));
      } else {
        const auto what = std::move(next->second);
        due_.erase(next);
        lock.unlock();
        what();
        lock.lock();
      }
    }
  }
  std::mutex mutex_;
  std::condition_variable changed_;
  std::multimap<Clock::time_point, std::function<void()>> due_;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace teletact::test
