#include "bench/load/figures.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "bench/load/processes.h"

namespace teletact::bench {
namespace {

constexpr double kLateS = 0.001;  // of the generator: what it then measures is its own

std::string ms(double s) {
  return std::isfinite(s) ? fmt::format("{:.3f}", 1e3 * s) : "not shown";
}

// Of streams, from the call on.
std::string told(const LatencyHistogram& first_word) {
  if (first_word.count() == 0) return "none was told";
  return fmt::format("told within {} ms (p50), {} ms (p99)", ms(first_word.quantile(0.5)),
                     ms(first_word.quantile(0.99)));
}

void print(const LoadFigures& c) {
  const Tally& t = c.tally;
  fmt::print(
      "{:4} clients{}: meant {:.0f}/s, answers {:.0f}/s; latency p50 {} ms, p95 {} ms, p99 {} ms (at most "
      "{}), "
      "max {} ms\n",
      c.clients, c.rate_hz > 0 ? fmt::format(" at {:.4g} Hz", c.rate_hz) : ", closed loop", c.intended_per_s,
      c.answers_per_s, ms(c.p50_s), ms(c.p95_s), ms(c.p99_s), ms(c.p99_bound_s), ms(c.max_s));
  if (t.held_back + t.unanswered + t.without_force > 0)
    fmt::print("     of {} poses {} were held back, {} never answered; {} answers without force\n",
               t.intended, t.held_back, t.unanswered, t.without_force);
  if (t.cancelled + t.opened > c.clients)
    fmt::print("     {} streams were opened, {} dropped; {}\n", t.opened, t.cancelled, told(t.opening));
  if (t.laws > 0) fmt::print("     {} pieces of contact laws\n", t.laws);
  if (!t.refused.empty()) fmt::print("     refused: {}; {}\n", of_statuses(t.refused), told(t.refusing));
  if (!t.failed.empty()) fmt::print("     failed: {}\n", of_statuses(t.failed));
  if (c.lateness_p99_s > kLateS)
    fmt::print(
        "     the generator itself was late by {} ms (p99): part of the latency is its own; give it more "
        "--processes, or fewer clients\n",
        ms(c.lateness_p99_s));
  std::fflush(stdout);
}

}  // namespace

std::string of_statuses(const std::map<std::string, std::uint64_t>& times) {
  std::string out;
  for (const auto& [status, n] : times) out += fmt::format("{}{} {}", out.empty() ? "" : ", ", n, status);
  return out;
}

double answered_share(const LoadFigures& c) {
  return static_cast<double>(c.tally.latency.count()) /
         static_cast<double>(std::max<std::uint64_t>(c.tally.intended, 1));
}

double own_answer_share(const LoadFigures& c) {
  return static_cast<double>(c.tally.counted_answers) /
         static_cast<double>(std::max<std::uint64_t>(c.tally.intended, 1));
}

bool carried(const LoadFigures& c, double latency_limit_s) {
  return c.tally.refused.empty() && c.tally.failed.empty() && answered_share(c) >= kAnswered &&
         own_answer_share(c) >= kOwnAnswer && c.p99_bound_s <= latency_limit_s;
}

LoadFigures measure_load(const LoadPlan& plan, unsigned processes) {
  LoadFigures c;
  c.rate_hz = plan.closed_loop ? 0 : plan.rate_hz, c.clients = plan.clients;
  c.tally = run_processes(plan, processes);
  c.intended_per_s = static_cast<double>(c.tally.intended) / plan.duration_s;
  c.answers_per_s = static_cast<double>(c.tally.counted_answers) / plan.duration_s;
  if (const LatencyHistogram& latency = c.tally.latency; latency.count() > 0) {
    c.p50_s = latency.quantile(0.5), c.p95_s = latency.quantile(0.95), c.p99_s = latency.quantile(0.99);
    c.max_s = latency.max_s();
    if (const auto bound = latency.bound(0.99)) c.p99_bound_s = *bound;
  }
  if (c.tally.lateness.count() > 0) c.lateness_p99_s = c.tally.lateness.quantile(0.99);
  print(c);
  return c;
}

}  // namespace teletact::bench
