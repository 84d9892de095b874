// How values are spread, in a fixed number of bytes: what an hour's ticks add up to is as large as a
// second's.
//
// Buckets grow by 2 %, on either side of zero, from 1e-9 to 1e6: a value is known to 1 %. The least and the
// most are kept as they are.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

namespace teletact::client {

class Histogram {
 public:
  static constexpr double kRelativeError = 0.01;

  // A value that is no number is none.
  void add(double value) noexcept {
    if (std::isnan(value)) return;
    ++counts_[bucket_of(value)];
    ++count_;
    min_ = std::min(min_, value);
    max_ = std::max(max_, value);
  }

  std::uint64_t count() const noexcept { return count_; }
  // The smallest value that covers `share` (0 .. 1) of all; 0 of none.
  double percentile(double share) const noexcept {
    if (count_ == 0) return 0;
    const double rank = std::ceil(std::clamp(share, 0.0, 1.0) * static_cast<double>(count_));
    if (!(rank > 1)) return min_;
    if (rank >= static_cast<double>(count_)) return max_;
    std::uint64_t below = 0;
    std::size_t bucket = 0;
    while (static_cast<double>(below += counts_[bucket]) < rank) ++bucket;
    return std::clamp(value_of(bucket), min_, max_);
  }
  // Calls each(value, count) for every bucket that holds anything, upwards.
  template <typename Each>
  void for_each(const Each& each) const {
    for (std::size_t k = 0; k < counts_.size(); ++k)
      if (counts_[k] > 0) each(std::clamp(value_of(k), min_, max_), counts_[k]);
  }

 private:
  static constexpr double kSmallest = 1e-9, kLogGrowth = 0.0198;  // sqrt(e^0.0198) is 1.00995
  static constexpr std::size_t kBuckets = 1745;                   // ln(1e15) / 0.0198, of either sign

  // Below zero downwards from kBuckets - 1, zero at kBuckets, above it upwards.
  static std::size_t bucket_of(double value) noexcept {
    const double size = std::abs(value);
    if (!(size >= kSmallest)) return kBuckets;
    const double steps = std::min(std::log(size / kSmallest) / kLogGrowth, static_cast<double>(kBuckets - 1));
    const auto step = static_cast<std::size_t>(steps) + 1;
    return value > 0 ? kBuckets + step : kBuckets - step;
  }
  static double value_of(std::size_t bucket) noexcept {
    if (bucket == kBuckets) return 0;
    const double sign = bucket > kBuckets ? 1 : -1;
    const double step = std::abs(static_cast<double>(bucket) - static_cast<double>(kBuckets));
    return sign * kSmallest * std::exp(kLogGrowth * (step - 0.5));
  }

  std::array<std::uint64_t, 2 * kBuckets + 1> counts_{};
  std::uint64_t count_ = 0;
  double min_ = std::numeric_limits<double>::infinity();
  double max_ = -std::numeric_limits<double>::infinity();
};

}  // namespace teletact::client
