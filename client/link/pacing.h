// How many poses are to be unanswered at once, so that answers come at the negotiated rate and nothing queues
// on the link: rate x round trip, where the link carries that; else as many as fill it.
//
// A link that is filled shows it by round trips above the shortest one of the last seconds. Past a period
// (and past twice what round trips differ by from one to the next, which jitter does and a queue does not) as
// many are in flight as the link held without the queue, and one less, so that the shortest round trip is
// seen again. Otherwise more: one for each answer until that happened first, from then on one or a little
// more for each round trip, and again one for each answer where twice what the link held made no
// queue. With the fewest in flight no queue is ours: what the link takes then is its own. While fewer are
// sent than might be, what comes says nothing of the room for more.
//
// Pure: time is an argument. One thread.
#pragma once

#include <array>
#include <cstdint>
#include <limits>

namespace teletact::client {

// The least value of the last seconds.
class RecentMin {
 public:
  static constexpr std::int64_t kBucketNs = 1'000'000'000;
  void add(double value, std::int64_t now_ns) noexcept;
  void restart() noexcept { *this = RecentMin(); }
  double value() const noexcept;  // infinity of none

 private:
  static constexpr double kNone = std::numeric_limits<double>::infinity();
  std::array<double, 4> buckets_{kNone, kNone, kNone, kNone};
  std::int64_t newest_ = 0;
};

class Pacing {
 public:
  static constexpr unsigned kFewest = 2;  // one is on its way while another is answered
  static constexpr unsigned kMax = 256;  // palpation.proto

  Pacing() noexcept = default;
  // A stream with answers every `period_s` at best, of which `credit` may be unacknowledged.
  Pacing(double period_s, unsigned credit) noexcept;

  // The period from now on: the service's, which it makes longer while it has more to do than it can.
  void keep(double period_s) noexcept { period_s_ = period_s; }
  void sent(std::uint64_t sequence) noexcept { sent_ = sequence; }
  // `round_trip_s`: from this pose's leaving to its answer's arrival, less what the service took.
  void answered(std::uint64_t sequence, double round_trip_s, std::int64_t now_ns) noexcept;

  unsigned in_flight() const noexcept;  // at most
  double interval_s() const noexcept;   // from one pose to the next, at least: evenly over a round trip

 private:
  void judge(std::int64_t now_ns) noexcept;

  double period_s_ = 0.002;
  unsigned credit_ = 1;
  double in_flight_ = kFewest;
  bool filling_ = true;  // no queue was seen yet, or none where one was
  double full_ = 0;      // so many the link held when one was seen last
  std::uint64_t sent_ = 0;
  std::uint64_t waits_for_ = 0;  // poses before it were under way before fewer were
  RecentMin shortest_s_;
  double smooth_s_ = 0, last_s_ = 0, differ_s_ = 0;  // round trips; from one to the next
  bool known_ = false;
  // Of the answers since they were judged last: the shortest round trip of these is no accident.
  unsigned answers_ = 0;
  double min_s_ = 0;
};

}  // namespace teletact::client
