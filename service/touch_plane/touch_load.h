// How many answers a second the touch plane gives one principal at most: as many as asked for, until turns
// that are due wait without end; then fewer to whoever has most, and more again by steps. So whoever asks for
// little is served as asked, and all that ask for more are served alike. The level stays near what the
// busiest has: where its periods are as long as they may be, a lower one would slow down the others alone.
// Time passes in windows of kWindow.
#pragma once

#include <algorithm>
#include <chrono>
#include <limits>

namespace teletact::service {

class TouchLoad {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds kWindow{100};
  static constexpr unsigned kStands = 2;  // windows in a row without an end of what waits: no accident
  static constexpr double kLess = 0.9, kMore = 1.02;  // of what was answered; of the level, each window
  static constexpr unsigned kEases = 10;              // windows in a row without it: the load has changed,
  static constexpr double kMuchMore = 1.1;            // and the level is not near any more
  static constexpr double kForgets = 0.95;  // a window in which the machine did other work says little
  static constexpr double kReleased = 1.5;  // times what the busiest has: it holds nobody back

  // Nothing waits now that a worker could do.
  void caught_up() { stands_ = false; }
  // A window is over, in which the busiest principal had so many answers a second for its weight.
  void settle(double busiest_hz) {
    lately_hz_ = std::max(busiest_hz, kForgets * lately_hz_);
    standing_ = stands_ ? standing_ + 1 : 0;
    eases_ = stands_ ? 0 : eases_ + 1;
    if (standing_ >= kStands && busiest_hz > 0) {  // without an answer there is nothing to measure it by
      level_hz_ = kLess * std::max(std::min(level_hz_, lately_hz_), busiest_hz);
      standing_ = 0;
    } else if (!stands_) {
      level_hz_ *= eases_ > kEases ? kMuchMore : kMore;
      if (level_hz_ > kReleased * busiest_hz) level_hz_ = kNone;
    }
    stands_ = true;
  }
  // For a weight of 1; infinity: as many as are asked for.
  double level_hz() const { return level_hz_; }

 private:
  static constexpr double kNone = std::numeric_limits<double>::infinity();
  double level_hz_ = kNone, lately_hz_ = 0;
  bool stands_ = false;  // so far, in this window
  unsigned standing_ = 0, eases_ = 0;
};

}  // namespace teletact::service
