// How long it is since a simulated device was read last: none at first, and never longer than it makes up
// for.
#pragma once

#include <algorithm>
#include <cstdint>

#include "client/clock/clock.h"

namespace teletact::client {

class ElapsedTime {
 public:
  explicit ElapsedTime(double longest_s) : longest_s_(longest_s) {}
  void restart() noexcept { started_ = false; }
  double since_last_s(std::int64_t now_ns) noexcept {
    if (!started_) last_ns_ = now_ns;
    started_ = true;
    const double elapsed_s = seconds(now_ns - last_ns_);
    last_ns_ = now_ns;
    return std::clamp(elapsed_s, 0.0, longest_s_);
  }

 private:
  double longest_s_;
  std::int64_t last_ns_ = 0;
  bool started_ = false;
};

}  // namespace teletact::client
