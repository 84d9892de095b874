// Has contacts corrected by a thread of its own, beside those who answer (T8.4): of each finger the newest
// hint, one after the other, there where it will be.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>

#include "service/contact/touch_model.h"

namespace teletact::service {

// Where a finger will be if it moves, and turns, as it does: so much later, and never far away.
TouchPose moved_on(const TouchPose&, double seconds);

// Thread-safe.
class Corrector {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::size_t kMaxFingers = 8;
  // Corrects at a pose. What it throws is kept, and said once in the log.
  using Correct = std::function<void(const Fingertip&, const TouchPose&)>;
  explicit Corrector(Correct correct) : correct_(std::move(correct)) {}
  ~Corrector();  // waits for the correction that is being made
  Corrector(const Corrector&) = delete;
  Corrector& operator=(const Corrector&) = delete;

  // A finger is here. Replaces its last hint unless that is being met; the oldest goes where too many wait.
  void ask(const Fingertip&, const TouchPose&);
  // Corrections that were made, or failed, so far.
  std::uint64_t done() const;
  // Until more than that many are done; false: not by then.
  bool wait_for_more_than(std::uint64_t done, Clock::time_point until);
  // Of the last correction; null: it went well.
  std::exception_ptr failure() const;
  void forget_failure();

 private:
  struct Hint {
    Fingertip tip;
    TouchPose pose;
  };
  void run();
  void meet(const Hint&);
  const Correct correct_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Hint> hints_;  // the oldest first
  std::exception_ptr failure_;
  std::string said_;
  std::uint64_t done_ = 0;
  double lasts_s_ = 0;  // a correction, about
  bool ends_ = false;
  std::thread thread_;
};

}  // namespace teletact::service
