#include "client/servo/clock_offset.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "client/clock/clock.h"

namespace teletact::client {
double ClockOffset::Best::error_s(std::int64_t now_ns) const noexcept {
  if (round_trip_s < 0) return std::numeric_limits<double>::infinity();
  return round_trip_s / 2 + kDrift * seconds(std::abs(now_ns - received_ns));
}

void ClockOffset::add(const StampExchange& exchange) noexcept {
  const std::int64_t away_ns = exchange.received_ns - exchange.sent_ns;
  const std::int64_t stayed_ns = exchange.left_ns - exchange.arrived_ns;
  const double round_trip_s = seconds(away_ns - stayed_ns);
  if (stayed_ns < 0 || round_trip_s < 0) return;
  constexpr double kWeight = 1.0 / 8;
  round_trip_s_ = known_ ? round_trip_s_ + kWeight * (round_trip_s - round_trip_s_) : round_trip_s;

  const auto count = static_cast<std::int64_t>(buckets_.size());
  const std::int64_t bucket = exchange.received_ns / kBucketNs;
  if (!known_) newest_bucket_ = bucket;
  // Buckets that this one has left behind held exchanges of a window ago.
  for (std::int64_t old = std::max(newest_bucket_, bucket - count) + 1; old <= bucket; ++old)
    buckets_[static_cast<std::size_t>(old % count)] = Best();
  newest_bucket_ = std::max(newest_bucket_, bucket);
  known_ = true;

  // offset = ((t1 - t0) + (t2 - t3)) / 2
  const double offset_s = 0.5 * (seconds(exchange.arrived_ns - exchange.sent_ns) +
                                 seconds(exchange.left_ns - exchange.received_ns));
  Best& kept = buckets_[static_cast<std::size_t>(bucket % count)];
  if (kept.round_trip_s < 0 || round_trip_s <= kept.round_trip_s)
    kept = {round_trip_s, offset_s, exchange.received_ns};
}

const ClockOffset::Best& ClockOffset::best(std::int64_t now_ns) const noexcept {
  return *std::min_element(buckets_.begin(), buckets_.end(), [now_ns](const Best& a, const Best& b) {
    return a.error_s(now_ns) < b.error_s(now_ns);
  });
}

double ClockOffset::offset_s(std::int64_t now_ns) const noexcept {
  return best(now_ns).offset_s;
}

double ClockOffset::error_s(std::int64_t now_ns) const noexcept {
  return best(now_ns).error_s(now_ns);
}

}  // namespace teletact::client
