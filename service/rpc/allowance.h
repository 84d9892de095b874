// So many per second, and that of `burst_s` at once after a pause: what a peer may cost that sends as fast as
// it can. Not thread-safe; takes the time as an argument.
#pragma once

#include <algorithm>
#include <chrono>

namespace teletact::service {

class Allowance {
 public:
  using Clock = std::chrono::steady_clock;
  explicit Allowance(double per_second, double burst_s = 0.1)
      : per_second_(per_second), max_(std::max(1.0, per_second * burst_s)), left_(max_) {}
  // Uses one up, or `some`; false when fewer are left by `now`.
  bool take(Clock::time_point now, double some = 1) {
    if (now > last_) {
      const double passed_s = std::chrono::duration<double>(now - last_).count();
      left_ = std::min(max_, left_ + passed_s * per_second_);
      last_ = now;
    }
    if (left_ < some) return false;
    left_ -= some;
    return true;
  }

 private:
  double per_second_, max_, left_;
  Clock::time_point last_{};
};

}  // namespace teletact::service
