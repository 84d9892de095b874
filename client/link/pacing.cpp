#include "client/link/pacing.h"

#include <algorithm>
#include <cmath>

namespace teletact::client {
namespace {

constexpr double kMaxStartS = 0.016;  // tolerated while no queue was seen: a busy machine makes as much

}  // namespace

void RecentMin::add(double value, std::int64_t now_ns) noexcept {
  const auto count = static_cast<std::int64_t>(buckets_.size());
  const std::int64_t bucket = now_ns / kBucketNs;
  for (std::int64_t old = std::max(newest_ + 1, bucket - count + 1); old <= bucket; ++old)
    buckets_[static_cast<std::size_t>(old % count)] = kNone;
  newest_ = std::max(newest_, bucket);
  double& least = buckets_[static_cast<std::size_t>(bucket % count)];
  least = std::min(least, value);
}

double RecentMin::value() const noexcept {
  return *std::min_element(buckets_.begin(), buckets_.end());
}

Pacing::Pacing(double period_s, unsigned credit) noexcept
    : period_s_(period_s), credit_(std::clamp(credit, 1U, kMax)) {}

unsigned Pacing::in_flight() const noexcept {
  return std::min(credit_, static_cast<unsigned>(in_flight_));
}

double Pacing::interval_s() const noexcept {
  return known_ ? std::max(period_s_, shortest_s_.value() / in_flight()) : period_s_;
}

void Pacing::answered(std::uint64_t sequence, double round_trip_s, std::int64_t now_ns) noexcept {
  constexpr double kSmooth = 1.0 / 8, kDiffer = 1.0 / 16;
  if (known_) {
    smooth_s_ += kSmooth * (round_trip_s - smooth_s_);
    differ_s_ += kDiffer * (std::abs(round_trip_s - last_s_) - differ_s_);
  } else {
    smooth_s_ = round_trip_s;
  }
  known_ = true;
  last_s_ = round_trip_s;
  shortest_s_.add(round_trip_s, now_ns);
  if (sequence < waits_for_) return;
  // Nobody wanted more in flight: what came says nothing of the room for it.
  const auto in_use = static_cast<double>(sent_ - sequence + 1);
  if (in_use < in_flight_ / 2 - 1) return;

  constexpr double kGrowth = 1.0 / 32, kFilling = 1.0 / 8;  // per answer, so much more in a round trip
  in_flight_ += std::max(1 / in_flight_, filling_ ? std::min(kFilling * in_flight_, 1.0) : kGrowth);
  min_s_ = answers_ == 0 ? round_trip_s : std::min(min_s_, round_trip_s);
  if (++answers_ >= std::max(2.0, in_flight_ / 4)) {
    judge(now_ns);
    answers_ = 0;
  }
  // No more than the rate needs, and one for each end.
  const double needed = kFewest + std::min(smooth_s_, 1.5 * shortest_s_.value()) / period_s_;
  in_flight_ = std::clamp(in_flight_, double{kFewest}, std::min<double>(needed, credit_ + 1));
}

void Pacing::judge(std::int64_t now_ns) noexcept {
  const double shortest_s = shortest_s_.value();
  const double jitter_s = std::min(2 * differ_s_, smooth_s_ / 3);
  const double start_s = filling_ ? std::min(shortest_s / 8, kMaxStartS) : 0;
  if (min_s_ - shortest_s <= period_s_ + std::max(jitter_s, start_s)) {
    filling_ = filling_ || in_flight_ > 2 * full_ + kFewest;
  } else if (in_flight_ < kFewest + 1) {
    shortest_s_.restart();
    shortest_s_.add(min_s_, now_ns);
    filling_ = true;
  } else {
    full_ = in_flight_ * shortest_s / last_s_;
    in_flight_ = full_ - 1;
    filling_ = false;
    waits_for_ = sent_ + 1;
  }
}

}  // namespace teletact::client
