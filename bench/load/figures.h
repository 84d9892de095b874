// What a load has come to, for people.
#pragma once

#include <limits>
#include <string>

#include "bench/load/tally.h"
#include "bench/load/worker.h"

namespace teletact::bench {

struct LoadFigures {
  double rate_hz = 0;  // of each client; 0: closed loop
  unsigned clients = 0;
  double intended_per_s = 0, answers_per_s = 0;
  // Latency. The bound: with a confidence of 99 %. NaN: too few.
  double p50_s = std::numeric_limits<double>::quiet_NaN(), p95_s = p50_s, p99_s = p50_s, p99_bound_s = p50_s,
         max_s = p50_s;
  double lateness_p99_s = 0;  // of the generator
  Tally tally;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(LoadFigures, rate_hz, clients, intended_per_s, answers_per_s, p50_s, p95_s,
                                   p99_s, p99_bound_s, max_s, lateness_p99_s, tally)

// Runs it by so many processes, and prints what came of it. Throws std::runtime_error.
LoadFigures measure_load(const LoadPlan&, unsigned processes);

// Of the poses, those with an answer to them or to a later one, and with one of their own.
double answered_share(const LoadFigures&);
double own_answer_share(const LoadFigures&);
inline constexpr double kAnswered = 0.99, kOwnAnswer = 0.9;  // where a load is carried

// Every stream was served, poses were answered, and the p99 is within the limit.
bool carried(const LoadFigures&, double latency_limit_s);

// "2 RESOURCE_EXHAUSTED, 1 UNAVAILABLE"; empty: none.
std::string of_statuses(const std::map<std::string, std::uint64_t>&);

}  // namespace teletact::bench
