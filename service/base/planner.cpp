#include "service/base/planner.h"

namespace teletact::service {

bool Planner::takes_shares(double over_allowed, Clock::time_point now) {
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

}  // namespace teletact::service
