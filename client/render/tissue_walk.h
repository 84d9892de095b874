// How the stiffness under a finger is taken to change between answers (T5.4): a random walk, Q dt, as long as
// it is short. What is stationary does not wander for ever: beyond the distance over which stiffness is
// correlated the last answer says no less than before, and the walk comes to its sill.
#pragma once

#include <algorithm>
#include <cmath>

namespace teletact::client {

// Tissue under a finger at 120 mm/s changes its stiffness by half within some 30 ms. Stiff tissue changes by
// more: the walk is the larger of a share of the stiffness and a floor, per square root of a second.
constexpr double kWalkShare = 3;
constexpr double kWalkNM = 500;
constexpr double kWalkSpeedMS = 0.12;     // of the finger that it was stated for
constexpr double kCorrelationM = 0.0045;  // of an inclusion of 10 mm, the middle of T2.7

// Seconds of walk that lie between an answer and a tool that is `age_s` later and `way_m` further on, the
// larger of both counting: T (1 - e^(-t/T)), T what the stated finger takes for the correlation length.
inline double walked_s(double age_s, double way_m, double correlation_m = kCorrelationM) noexcept {
  const double longest_s = correlation_m / kWalkSpeedMS;
  return -longest_s * std::expm1(-std::max({age_s, way_m / kWalkSpeedMS, 0.0}) / longest_s);
}

}  // namespace teletact::client
