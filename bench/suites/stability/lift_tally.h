// What many presses, lifts and taps come to.
#pragma once

#include <algorithm>
#include <cstddef>
#include <nlohmann/json.hpp>

#include "bench/stability/lift.h"

namespace teletact::bench {

struct LiftTally {
  std::size_t trials = 0, in_air = 0, degraded = 0, damped = 0, not_enabled = 0;
  double in_air_n = 0, over_allowed = 0, over_paid = 0, given_j = 0, max_force = 0, min_ledger_j = 0;
  void add(const LiftOptions& t, const LiftResult& r) {
    ++trials;
    in_air += r.in_air_n > 0;
    degraded += r.degraded_share > 0;
    damped += r.damping_share > 0;
    not_enabled += r.enabled_share < 1;
    in_air_n = std::max(in_air_n, r.in_air_n);
    over_allowed = std::max(over_allowed, r.over_allowed);
    over_paid = std::max(over_paid, r.over_paid);
    given_j = std::max(given_j, r.given_j);
    max_force = std::max(max_force, r.largest_n / t.device.largest_force_n);
    min_ledger_j = std::min(min_ledger_j, r.min_ledger_j);
  }
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(LiftTally, trials, in_air, degraded, damped, not_enabled, in_air_n,
                                   over_allowed, over_paid, given_j, max_force, min_ledger_j)

}  // namespace teletact::bench
