// Which of several models of a touch answers: the cheapest that is good enough (T9.5).
#pragma once

#include <chrono>
#include <cstddef>
#include <optional>
#include <span>

namespace teletact::service {

// Of one finger. It climbs to a dearer model at once, and descends to a cheaper one that has been twice as
// good as it must be for a while, so that a finger on a border does not make it go to and fro.
class Planner {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::seconds kPatience{1};
  static constexpr double kToDescend = 0.5;

  explicit Planner(Clock::duration patience = kPatience) : patience_(patience) {}
  // over_allowed: what each model may be off by over what is allowed, the cheapest first. Index of the one
  // that answers; the last one where none is good enough. As often as the finger is answered.
  std::size_t choose(std::span<const double> over_allowed, Clock::time_point now);

 private:
  Clock::duration patience_;
  std::optional<std::size_t> chosen_;              // none yet: the first choice waits for nothing
  std::optional<Clock::time_point> better_since_;  // a cheaper one is good enough to descend to
};

}  // namespace teletact::service
