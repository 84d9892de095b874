#include "bench/load/tally.h"

#include <algorithm>

namespace teletact::bench {

void Tally::add(const Tally& other) {
  latency.add(other.latency), lateness.add(other.lateness);
  intended += other.intended, held_back += other.held_back, unanswered += other.unanswered;
  answers += other.answers, counted_answers += other.counted_answers;
  without_force += other.without_force, laws += other.laws;
  opened += other.opened, cancelled += other.cancelled;
  opening.add(other.opening), refusing.add(other.refusing);
  for (const auto& [status, times] : other.refused) refused[status] += times;
  for (const auto& [status, times] : other.failed) failed[status] += times;
}

std::uint64_t Unanswered::count(double from_s) const {
  return static_cast<std::uint64_t>(
      std::count_if(due_s_.begin(), due_s_.end(), [&](double due_s) { return due_s >= from_s; }));
}

}  // namespace teletact::bench
