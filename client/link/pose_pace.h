// When the poses of one stream go out: an interval apart, and where the link has no room for another, or the
// servo gave no other, as heartbeats alone.
//
// Pure: time is an argument. One thread.
#pragma once

#include <algorithm>
#include <cstdint>

#include "client/clock/clock.h"

namespace teletact::client {

class PosePace {
 public:
  static constexpr double kHeartbeatS = 0.1;
  static constexpr double kMinS = 0.001;  // between poses
  // Where a law is rendered answers only check it; and where they bring tactile images, too.
  static constexpr double kLawPeriodS = 0.05, kTactilePeriodS = 0.02;
  static constexpr std::int64_t kLookAgainNs = 250'000;  // for the servo's next pose

  // From one pose to the next. `link_s`: as often as the link and the service take them.
  static double interval_s(double link_s, bool by_law, bool tactile) noexcept {
    const double by_law_s = tactile ? kTactilePeriodS : kLawPeriodS;
    return std::max({link_s, kMinS, by_law ? by_law_s : 0.0});
  }

  explicit PosePace(std::int64_t now_ns) noexcept : next_ns_(now_ns) {}

  std::int64_t due_ns(bool room, double round_trip_s) const noexcept {
    return next_ns_ + (room ? 0 : to_ns(std::max(kHeartbeatS, round_trip_s)));
  }
  // Of a pose that is due: one that was sent before tells the service nothing, unless as a heartbeat.
  bool worth_sending(bool fresh, std::int64_t now_ns) const noexcept {
    return fresh || now_ns - sent_ns_ >= to_ns(kHeartbeatS);
  }
  void look_again(std::int64_t now_ns) noexcept { next_ns_ = now_ns + kLookAgainNs; }
  // Keeps the average rate when a wake-up is late, without bursts.
  void sent(double interval_s, std::int64_t now_ns) noexcept {
    const std::int64_t interval_ns = to_ns(interval_s);
    next_ns_ = std::max(next_ns_ + interval_ns, now_ns + interval_ns / 2);
    sent_ns_ = now_ns;
  }

 private:
  std::int64_t next_ns_, sent_ns_ = 0;
};

}  // namespace teletact::client
