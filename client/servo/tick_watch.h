// Tells from beside the servo whether its device's adapter returns from its calls: a loop that makes no tick
// for kStuckS, its first included, waits in one. Time counts only as far as somebody looked: a process that
// was stopped meanwhile, or a machine too busy for who looks, is no adapter's doing.
#pragma once

#include <algorithm>
#include <cstdint>
#include <optional>

namespace teletact::client {

class TickWatch {
 public:
  static constexpr double kStuckS = 1;
  static constexpr double kLookS = 0.1;  // the most that counts from look to look

  // For how long the loop, which has begun, has made no tick; `now_s` of any clock that only goes forward.
  double still_s(std::uint64_t ticks, double now_s) noexcept {
    const bool ticked = !looked_s_ || ticks != ticks_;
    still_s_ = ticked ? 0 : still_s_ + std::min(now_s - *looked_s_, kLookS);
    ticks_ = ticks;
    looked_s_ = now_s;
    return still_s_;
  }

 private:
  std::uint64_t ticks_ = 0;
  std::optional<double> looked_s_;
  double still_s_ = 0;
};

}  // namespace teletact::client
