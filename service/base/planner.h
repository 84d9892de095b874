// Which of two models of a touch answers: shares of the force where they are good enough, else the nodes
// (T9.5).
#pragma once

#include <chrono>
#include <optional>

namespace teletact::service {

// Of one finger. It leaves shares for the nodes at once, and comes back to shares that have been twice as
// good as they must be for a while, so that a finger on a border does not make it go to and fro.
class Planner {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::seconds kPatience{1};
  static constexpr double kToComeBack = 0.5;

  explicit Planner(Clock::duration patience = kPatience) : patience_(patience) {}
  // over_allowed: what shares may be off by over what is allowed. Whether they answer. As often as the finger
  // is answered.
  bool takes_shares(double over_allowed, Clock::time_point now) {
    const bool by_nodes = shares_ == false, waits = patience_ > Clock::duration::zero();
    if (!by_nodes || !waits) {
      shares_ = over_allowed <= 1;
      better_since_.reset();
    } else if (!(over_allowed <= kToComeBack)) {
      better_since_.reset();
    } else if (!better_since_) {
      better_since_ = now;
    } else if (now - *better_since_ >= patience_) {
      shares_ = true;
    }
    return *shares_;
  }

 private:
  Clock::duration patience_;
  std::optional<bool> shares_;                     // none yet: the first choice waits for nothing
  std::optional<Clock::time_point> better_since_;  // shares are good enough to come back to
};

}  // namespace teletact::service
