#include "service/plan/planner.h"

#include <algorithm>

namespace teletact::service {

std::size_t Planner::choose(std::span<const double> over_allowed, Clock::time_point now) {
  const auto cheapest = [&](double most) {
    const auto found = std::ranges::find_if(over_allowed, [most](double over) { return over <= most; });
    return std::min<std::size_t>(static_cast<std::size_t>(found - over_allowed.begin()),
                                 over_allowed.size() - 1);
  };
  const bool waits = patience_ > Clock::duration::zero();
  if (!chosen_ || !waits || !(over_allowed[*chosen_] <= 1)) {
    chosen_ = cheapest(1);
    better_since_.reset();
    return *chosen_;
  }
  const std::size_t better = cheapest(kToDescend);
  if (better >= *chosen_) {
    better_since_.reset();
  } else if (!better_since_) {
    better_since_ = now;
  } else if (now - *better_since_ >= patience_) {
    chosen_ = better;
    better_since_.reset();
  }
  return *chosen_;
}

}  // namespace teletact::service
