// teletact-bench servo: the 1 kHz loop of a whole session of touching, beside a running service: its period,
// lateness, overruns and slack, and what its thread takes from the heap (nothing). Beside it, in the same
// seconds, a bare timer: what it loses too is the machine's.
//
// The suite touches a scene of its own, whose forces are first checked against the dense reference (T4.1).
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <memory>
#include <numeric>

#include "bench/curves.h"
#include "bench/own_scene.h"
#include "bench/run_suite.h"
#include "bench/service.h"
#include "bench/suites/servo/bare_timer.h"
#include "client/session/operator_session.h"
#include "tests/support/allocation/allocation_count.h"

namespace teletact::bench {
namespace {

constexpr double kRateHz = 999;       // of 1000: a tick that is past is skipped, not made up for
constexpr double kLostHz = 0.5;       // at most, beyond what the bare timer loses beside it
constexpr double kStartAndEndS = 60;  // of a session, at most, in which force is not on
constexpr double kQuickS = 3, kIndentationM = 0.004;
constexpr const char* kScene = "bench-servo";
constexpr double kBinS = 10e-6;
constexpr std::size_t kBins = 2000;  // up to 20 ms; the last holds all above

struct Arguments : SuiteOptions {
  Service service;
  double duration_s = 600;
};

using Bins = std::vector<std::uint64_t>;

Bins bins_of(auto&& for_each) {
  Bins bins(kBins, 0);
  for_each([&](double s, std::uint64_t count) {
    bins[std::min(kBins - 1, static_cast<std::size_t>(std::max(s, 0.0) / kBinS))] += count;
  });
  return bins;
}
Bins histogram(const std::vector<double>& seconds) {
  return bins_of([&](auto&& add) {
    for (const double s : seconds) add(s, 1);
  });
}
Bins histogram(const client::Histogram& seconds) {
  return bins_of([&](auto&& add) { seconds.for_each(add); });
}
Quantiles quantiles_of(const client::Histogram& seconds) {
  if (seconds.count() == 0) throw BenchError("no tick was seen: there is nothing to report");
  return {seconds.count(),          seconds.percentile(0),    seconds.percentile(0.5),
          seconds.percentile(0.95), seconds.percentile(0.99), seconds.percentile(1)};
}

struct Slack {
  double min = 0, p01 = 0, p50 = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Slack, min, p01, p50)
struct BareFigures {
  double rate_hz = 0;
  std::uint64_t overruns = 0;
  Quantiles lateness_s;
  Bins lateness_histogram;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(BareFigures, rate_hz, overruns, lateness_s, lateness_histogram)
struct LoopFigures {
  double duration_s = 0, with_force_s = 0;
  std::string scheduling;
  double processor_s = 0;  // of this process, all threads
  std::uint64_t ticks = 0;
  double rate_hz = 0;
  std::size_t allocations = 0;
  std::uint64_t overruns = 0, telemetry_dropped = 0, answers = 0, streams = 0;
  double largest_force_n = 0;
  BareFigures bare_timer;
  Quantiles period_s, lateness_s;
  Slack slack_s;
  Quantiles model_age_s;
  double histogram_bin_s = kBinS;
  Bins lateness_histogram;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(LoopFigures, duration_s, with_force_s, scheduling, processor_s, ticks,
                                   rate_hz, allocations, overruns, telemetry_dropped, answers, streams,
                                   largest_force_n, bare_timer, period_s, lateness_s, slack_s, model_age_s,
                                   histogram_bin_s, lateness_histogram)
struct Figures {
  Checked checked;
  LoopFigures loop;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, checked, loop)

LoopFigures touch(const Arguments& arguments) {
  client::OperatorSessionOptions session;
  session.address = arguments.service.address;
  session.credentials = arguments.service.credentials;
  session.open.set_scene_id(kScene);
  session.open.set_period_s(0.002);
  session.open.set_credit(client::Pacing::kMax);
  session.hand.indentation_m = kIndentationM;
  session.duration_s = arguments.quick ? std::min(kQuickS, arguments.duration_s) : arguments.duration_s;
  std::size_t allocations = 0;
  session.servo_begins = [] { test::count_allocations(true); };
  session.servo_ended = [&allocations] {
    test::count_allocations(false);
    allocations = test::counted_allocations();
  };
  const std::clock_t before = std::clock();
  const std::atomic<bool> stop{false};
  BareTimer bare(session.duration_s + kStartAndEndS);
  const client::TouchSummary summary = client::run_operator_session(session, stop);
  bare.stop();
  const client::TickStatistics& ticks = summary.ticks;
  return {ticks.duration_s(),
          ticks.enabled_s(),
          summary.real_time.text,
          static_cast<double>(std::clock() - before) / CLOCKS_PER_SEC,
          ticks.ticks(),
          ticks.rate_hz(),
          allocations,
          summary.overruns,
          summary.telemetry_dropped,
          summary.link.answers,
          summary.link.streams,
          ticks.largest_force_n(),
          {bare.rate_hz(), bare.overruns(), quantiles(bare.lateness_s()), histogram(bare.lateness_s())},
          quantiles_of(ticks.period_s()),
          quantiles_of(ticks.lateness_s()),
          {ticks.slack_s().percentile(0), ticks.slack_s().percentile(0.01), ticks.slack_s().percentile(0.5)},
          quantiles_of(ticks.model_age_s()),
          kBinS,
          histogram(ticks.lateness_s())};
}

void print(const LoopFigures& loop) {
  const BareFigures& bare = loop.bare_timer;
  std::printf("%.0f s at %.2f Hz, %lu ticks; %s\n", loop.duration_s, loop.rate_hz, loop.ticks,
              loop.scheduling.c_str());
  std::printf("  period    p50 %.0f us, p99 %.0f us, max %.0f us\n", 1e6 * loop.period_s.p50,
              1e6 * loop.period_s.p99, 1e6 * loop.period_s.max);
  std::printf("  lateness  p50 %.0f us, p99 %.0f us, max %.0f us; %lu overruns (woken > 1 ms late)\n",
              1e6 * loop.lateness_s.p50, 1e6 * loop.lateness_s.p99, 1e6 * loop.lateness_s.max, loop.overruns);
  std::printf("  a bare timer beside it: %.2f Hz, lateness p99 %.0f us, max %.0f us; %lu overruns\n",
              bare.rate_hz, 1e6 * bare.lateness_s.p99, 1e6 * bare.lateness_s.max, bare.overruns);
  std::printf("  slack     p50 %.0f us, p01 %.0f us, min %.0f us\n", 1e6 * loop.slack_s.p50,
              1e6 * loop.slack_s.p01, 1e6 * loop.slack_s.min);
  std::printf("  age of what is felt p99 %.1f ms; %.1f %% of a core\n", 1e3 * loop.model_age_s.p99,
              100 * loop.processor_s / loop.duration_s);
}

// Share of the wake-ups that were later than so much.
Curve survival(const char* title, const char* style, const Bins& bins) {
  const auto all = static_cast<double>(std::accumulate(bins.begin(), bins.end(), std::uint64_t{0}));
  double later = all;
  Curve curve{.title = title, .style = style};
  for (std::size_t k = 0; k < bins.size() && later > 0; ++k) {
    curve.add(1e3 * kBinS * static_cast<double>(k + 1), later / all);
    later -= static_cast<double>(bins[k]);
  }
  return curve;
}

void draw(const Figures& figures, const std::filesystem::path& folder) {
  const LoopFigures& loop = figures.loop;
  plot(folder / "servo.png",
       script_of({survival("servo", "steps lw 2", loop.lateness_histogram),
                  survival("bare timer", "steps lw 2 lc rgb '#999999'", loop.bare_timer.lateness_histogram)},
                 "set termoption noenhanced\nset logscale xy\nset format y '%.0e'\n" +
                     axes(fmt::format("{:.0f} s, {}", loop.duration_s, loop.scheduling),
                          "woken later than (ms)", "share of the ticks")));
}

Figures measure(const Arguments& arguments, Promises& promises) {
  const auto channel = connect(arguments.service);
  const Checked checked = make_checked_scene(channel, kScene, own_tissue(), kIndentationM);
  Figures figures{checked, touch(arguments)};
  const LoopFigures& loop = figures.loop;
  print(loop);
  promises.push_back({"allocations_in_the_loop", static_cast<double>(loop.allocations), 0});
  promises.push_back({"servo_rate", loop.rate_hz, kRateHz, "Hz", false});
  promises.push_back(
      {"servo_rate_lost_beyond_a_bare_timers", loop.bare_timer.rate_hz - loop.rate_hz, kLostHz, "Hz"});
  promises.push_back({"telemetry_dropped", static_cast<double>(loop.telemetry_dropped), 0});
  return figures;
}

}  // namespace

void add_servo_suite(CLI::App& app, bool& met) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command =
      add_suite(app, "servo", "the 1 kHz loop beside a running service: period, overruns, slack, heap",
                arguments, met, measure, draw);
  add_service_options(command, arguments->service);
  command.add_option("--duration-s", arguments->duration_s, "with force on")->check(CLI::PositiveNumber);
}

}  // namespace teletact::bench
