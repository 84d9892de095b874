// How long a link lets one wait for the next answer, from the answers that came: of the longest interval in
// each tenth of a second of the last two with answers, the one that nine tenths of them do not exceed. So
// neither a constant round trip nor a steady slow rate is silence, and a stall or two changes nothing.
//
// Pure: time is an argument. One thread.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>

namespace teletact::client {

class ArrivalIntervals {
 public:
  static constexpr std::int64_t kBucketNs = 100'000'000;
  static constexpr std::size_t kBuckets = 20;

  void add(std::int64_t received_ns) noexcept {
    const std::int64_t interval_ns = count_ > 0 ? received_ns - last_ns_ : 0;
    const std::int64_t bucket = received_ns / kBucketNs;
    if (count_ == 0 || bucket != bucket_) longest_ns_[count_++ % kBuckets] = 0;
    std::int64_t& longest_ns = longest_ns_[(count_ - 1) % kBuckets];
    longest_ns = std::max(longest_ns, interval_ns);
    bucket_ = bucket;
    last_ns_ = received_ns;
  }
  // 0 before there are two answers.
  double expected_s() const noexcept {
    auto sorted_ns = longest_ns_;
    const std::size_t known = std::min(count_, kBuckets);
    if (known == 0) return 0;
    const auto end = sorted_ns.begin() + static_cast<std::ptrdiff_t>(known);
    const auto usual = sorted_ns.begin() + static_cast<std::ptrdiff_t>((9 * known + 9) / 10 - 1);
    std::nth_element(sorted_ns.begin(), usual, end);
    return 1e-9 * static_cast<double>(*usual);
  }

 private:
  std::array<std::int64_t, kBuckets> longest_ns_{};
  std::size_t count_ = 0;  // buckets with answers so far
  std::int64_t bucket_ = 0, last_ns_ = 0;
};

}  // namespace teletact::client
