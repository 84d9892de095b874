// When a call of the callback interface may be finished: once, after somebody has ended it, and with nothing
// under way that Finish must not overtake. gRPC aborts the process when a call is finished twice, and forgets
// the reactor once it is finished and idle; cancellation may come at any moment, from another thread.
//
// Whoever starts an operation, or uses what OnDone takes away, holds the call meanwhile: begin() ... over().
// Whoever has a reason ends it: end(). Of all these calls exactly one returns true: that caller finishes.
// Thread-safe; knows no gRPC but its status.
#pragma once

#include <grpcpp/support/status.h>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <mutex>
#include <optional>
#include <utility>

namespace teletact::service {

class CallLife {
 public:
  using Clock = std::chrono::steady_clock;

  // False once the call has ended: begin nothing.
  [[nodiscard]] bool begin() {
    const std::lock_guard lock(mutex_);
    if (ended_at_) return false;
    ++held_;
    return true;
  }
  // After a begin() that said true. True: finish now.
  [[nodiscard]] bool over() {
    const std::lock_guard lock(mutex_);
    --held_;
    return due();
  }
  // The first call's status counts. True: finish now.
  [[nodiscard]] bool end(grpc::Status status, Clock::time_point now = Clock::now()) {
    const std::lock_guard lock(mutex_);
    if (!ended_at_) {
      status_ = std::move(status);
      ended_at_ = now;
      ended_ = true;
    }
    return due();
  }

  bool ended() const { return ended_.load(); }
  std::optional<Clock::time_point> ended_at() const {
    const std::lock_guard lock(mutex_);
    return ended_at_;
  }
  // OK until it has ended.
  grpc::Status status() const {
    const std::lock_guard lock(mutex_);
    return status_;
  }

 private:
  bool due() {
    if (!ended_at_ || held_ > 0) return false;
    return !std::exchange(finished_, true);
  }
  mutable std::mutex mutex_;
  std::atomic<bool> ended_{false};  // as ended_at_, for those who may not wait
  std::optional<Clock::time_point> ended_at_;
  grpc::Status status_;
  std::size_t held_ = 0;
  bool finished_ = false;
};

}  // namespace teletact::service
