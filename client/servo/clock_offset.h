// How far the service's clock is from ours, and how long a message takes there and back, from stamps that
// answers carry anyway.
//
// As NTP does it (RFC 5905): a message leaves here at t0, arrives there at t1, its answer leaves there at t2
// and arrives here at t3; round trip = (t3 - t0) - (t2 - t1), offset (theirs minus ours) =
// ((t1 - t0) + (t2 - t3)) / 2. Queues only ever add, so of all exchanges of a window the one with the
// shortest round trip says most: its offset is off by half of its round trip at most, however unequal the two
// ways are, plus what the clocks have drifted apart since.
#pragma once

#include <array>
#include <cstdint>

namespace teletact::client {

struct StampExchange {
  std::int64_t sent_ns = 0;      // our clock
  std::int64_t arrived_ns = 0;   // their clock
  std::int64_t left_ns = 0;      // their clock
  std::int64_t received_ns = 0;  // our clock
};

class ClockOffset {
 public:
  static constexpr std::int64_t kBucketNs = 2'000'000'000;  // the shortest round trip of each is kept
  static constexpr double kDrift = 100e-6;                  // of two crystals apart, at most

  // An exchange that no pair of clocks could have made (round trip or stay below zero) is ignored.
  void add(const StampExchange& exchange) noexcept;
  // Another clock at the other end: the service was restarted.
  void reset() noexcept { *this = ClockOffset(); }

  bool known() const noexcept { return known_; }
  // Smoothed over about eight exchanges, as TCP does; 0 before the first.
  double round_trip_s() const noexcept { return round_trip_s_; }
  // Theirs minus ours, of the exchange whose bound is the smallest at `now_ns` (our clock); 0 before the
  // first.
  double offset_s(std::int64_t now_ns) const noexcept;
  // The offset is off by no more than this; infinity before the first.
  double error_s(std::int64_t now_ns) const noexcept;

 private:
  struct Best {
    double round_trip_s = -1;  // < 0: none
    double offset_s = 0;
    std::int64_t received_ns = 0;
    double error_s(std::int64_t now_ns) const noexcept;
  };
  const Best& best(std::int64_t now_ns) const noexcept;

  std::array<Best, 8> buckets_{};  // of the last 16 s
  std::int64_t newest_bucket_ = 0;
  double round_trip_s_ = 0;
  bool known_ = false;
};

}  // namespace teletact::client
