// What a load has come to; that of several processes adds up.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <nlohmann/json.hpp>
#include <string>

#include "bench/load/latency_histogram.h"

namespace teletact::bench {

struct Tally {
  // From when a pose was meant to be sent to the first answer to it or to a later one.
  LatencyHistogram latency;
  LatencyHistogram lateness;   // of the generator itself: from when a pose was meant to when it was taken up
  std::uint64_t intended = 0;  // poses
  // Of them. Held back: a newer one took its place while too many were in flight. Unanswered: when the stream
  // ended.
  std::uint64_t held_back = 0, unanswered = 0;
  // All of them, and those to a pose that is counted. Without force: neither OK nor DEGRADED.
  std::uint64_t answers = 0, counted_answers = 0, without_force = 0;
  std::uint64_t laws = 0;                   // pieces of contact laws
  std::uint64_t opened = 0, cancelled = 0;  // streams
  LatencyHistogram opening, refusing;       // from a stream's call, with its connection, to its first word
  // Streams by status: before they were open, and after.
  std::map<std::string, std::uint64_t> refused, failed;

  void add(const Tally& other);
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Tally, latency, lateness, intended, held_back, unanswered, answers,
                                   counted_answers, without_force, laws, opened, cancelled, opening, refusing,
                                   refused, failed)

// Poses of one stream that were meant to be sent and are not answered yet. The service answers the newest
// pose that it has: an answer to one is an answer to all before it.
class Unanswered {
 public:
  // Its sequence, from 1.
  std::uint64_t intend(double due_s) {
    due_s_.push_back(due_s);
    return first_ + due_s_.size() - 1;
  }
  // Those meant before `from_s` are not counted. Says how many were.
  std::uint64_t answered(std::uint64_t sequence, double now_s, double from_s, LatencyHistogram& latency) {
    const std::uint64_t before = latency.count();
    for (; first_ <= sequence && !due_s_.empty(); ++first_) {
      if (due_s_.front() >= from_s) latency.add(now_s - due_s_.front());
      due_s_.pop_front();
    }
    return latency.count() - before;
  }
  std::uint64_t count(double from_s) const;

 private:
  std::deque<double> due_s_;
  std::uint64_t first_ = 1;
};

}  // namespace teletact::bench
