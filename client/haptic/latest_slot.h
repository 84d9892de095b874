// One slot between one writer and one reader; the newest value wins, nobody waits. A triple buffer: the
// writer and the reader each own one copy and swap it for the middle one, so no byte is ever read while it is
// written.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>

namespace teletact::client {

template <typename Value>
class LatestSlot {
 public:
  // Writer's thread only.
  void put(const Value& value) noexcept {
    values_[writing_] = value;
    writing_ = middle_.exchange(writing_ | kFresh, std::memory_order_acq_rel) & kIndex;
  }
  // Reader's thread only. False, and `value` untouched, when nothing was put since the last take.
  bool take(Value& value) noexcept {
    if (!(middle_.load(std::memory_order_relaxed) & kFresh)) return false;
    reading_ = middle_.exchange(reading_, std::memory_order_acq_rel) & kIndex;
    value = values_[reading_];
    return true;
  }

 private:
  static constexpr std::uint8_t kIndex = 3;
  static constexpr std::uint8_t kFresh = 4;
  std::array<Value, 3> values_{};
  std::uint8_t writing_ = 0;
  std::uint8_t reading_ = 1;
  std::atomic<std::uint8_t> middle_{2};
};

}  // namespace teletact::client
