// The states that a stream tells of something, with a credit of one: the next is sent once the last is
// acknowledged, so that a reader that stops reading is never more than one state behind. Not thread-safe.
#pragma once

#include <fmt/format.h>

#include <chrono>
#include <cstdint>
#include <stdexcept>

#include "service/base/seconds.h"
#include "service/scene/errors.h"

namespace teletact::service {

class SentStates {
 public:
  using Clock = std::chrono::steady_clock;

  // The newest that was received. Throws std::invalid_argument for one that was not sent.
  void acknowledge(std::uint64_t state) {
    if (state > count_ || state < acknowledged_)
      throw std::invalid_argument(fmt::format(
          "acknowledged: {}, but {} states were sent and {} acknowledged; give the number of the newest "
          "state received",
          state, count_, acknowledged_));
    acknowledged_ = state;
  }
  // Whether the next may be sent. `sent`: the last was sent. Throws Error(kDeadline) when that is not
  // acknowledged for too long.
  bool may_tell(Clock::time_point now, bool sent, double acknowledge_s) const {
    if (acknowledged_ == count_ && sent) return true;
    if (now - since_ > seconds(acknowledge_s))
      throw Error(ErrorKind::kDeadline, fmt::format("acknowledged: state {} was not within {} s; acknowledge "
                                                    "each state, or open a new stream",
                                                    count_, acknowledge_s));
    return false;
  }
  // Its number, from 1.
  std::uint64_t tell(Clock::time_point now) {
    since_ = now;
    return ++count_;
  }
  std::uint64_t count() const { return count_; }
  Clock::time_point since() const { return since_; }  // the last was sent

 private:
  std::uint64_t count_ = 0, acknowledged_ = 0;
  Clock::time_point since_{};
};

}  // namespace teletact::service
