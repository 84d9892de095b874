// teletact-bench servo: the 1 kHz loop of a whole session of touching, beside a running service: its period,
// lateness, overruns and slack, and what its thread takes from the heap (nothing). Beside it, in the same
// seconds, a bare timer: what it loses too is the machine's.
//
// The suite touches a scene of its own, whose forces are first checked against the dense reference (T4.1).
#include <fmt/format.h>
#include <grpcpp/grpcpp.h>
#include <sys/resource.h>

#include <cmath>
#include <cstdio>
#include <memory>
#include <numeric>

#include "bench/own_scene.h"
#include "bench/service.h"
#include "bench/suite.h"
#include "bench/suites/servo/bare_timer.h"
#include "client/link/channel.h"
#include "client/session/operator_session.h"
#include "tests/support/allocation/allocation_count.h"

namespace teletact::bench {
namespace {

using nlohmann::json;

constexpr double kRateHz = 999;       // of 1000: a tick that is past is skipped, not made up for
constexpr double kLostHz = 0.5;       // at most, beyond what the bare timer loses beside it
constexpr double kStartAndEndS = 60;  // of a session, at most, in which force is not on
constexpr double kConnectWaitS = 5, kQuickS = 3, kIndentationM = 0.004;
constexpr const char* kScene = "bench-servo";
constexpr double kBinS = 10e-6;
constexpr std::size_t kBins = 2000;  // up to 20 ms; the last holds all above

struct Arguments {
  SuiteOptions suite;
  Service service;
  double duration_s = 600;
};

std::size_t bin_of(double seconds) {
  return std::min(kBins - 1, static_cast<std::size_t>(std::max(seconds, 0.0) / kBinS));
}
std::vector<std::uint64_t> histogram(const std::vector<double>& seconds) {
  std::vector<std::uint64_t> counts(kBins, 0);
  for (const double s : seconds) ++counts[bin_of(s)];
  return counts;
}
std::vector<std::uint64_t> histogram(const client::Histogram& seconds) {
  std::vector<std::uint64_t> counts(kBins, 0);
  seconds.for_each([&](double s, std::uint64_t count) { counts[bin_of(s)] += count; });
  return counts;
}
json quantiles_of(const client::Histogram& seconds) {
  if (seconds.count() == 0) throw BenchError("no tick was seen: there is nothing to report");
  return {{"count", seconds.count()},
          {"p50", seconds.percentile(0.5)},
          {"p95", seconds.percentile(0.95)},
          {"p99", seconds.percentile(0.99)},
          {"max", seconds.percentile(1)}};
}

// Of this process, all threads, user and system.
double processor_s() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

json measure(const Arguments& arguments) {
  client::OperatorSessionOptions session;
  session.address = arguments.service.address;
  session.tls_ca = arguments.service.tls_ca;
  session.open.set_scene_id(kScene);
  session.open.set_period_s(0.002);
  session.open.set_credit(2);
  session.hand.indentation_m = kIndentationM;
  session.duration_s = arguments.suite.quick ? std::min(kQuickS, arguments.duration_s) : arguments.duration_s;
  std::size_t allocations = 0;
  session.servo_begins = [] { test::count_allocations(true); };
  session.servo_ended = [&allocations] {
    test::count_allocations(false);
    allocations = test::counted_allocations();
  };
  const double before_s = processor_s();
  const std::atomic<bool> stop{false};
  BareTimer bare(session.duration_s + kStartAndEndS);
  const client::TouchSummary summary = client::run_operator_session(session, stop);
  bare.stop();
  const client::TickStatistics& ticks = summary.ticks;
  return {{"duration_s", ticks.duration_s()},
          {"with_force_s", ticks.enabled_s()},
          {"scheduling", summary.real_time.text},
          {"real_time", summary.real_time.fifo},
          {"processor_s", processor_s() - before_s},
          {"ticks", ticks.ticks()},
          {"rate_hz", ticks.rate_hz()},
          {"allocations", allocations},
          {"overruns", summary.overruns},
          {"overrun_share", static_cast<double>(summary.overruns) / static_cast<double>(ticks.ticks())},
          {"telemetry_dropped", summary.telemetry_dropped},
          {"answers", summary.link.answers},
          {"streams", summary.link.streams},
          {"largest_force_n", ticks.largest_force_n()},
          {"bare_timer",
           {{"rate_hz", bare.rate_hz()},
            {"overruns", bare.overruns()},
            {"lateness_s", quantiles(bare.lateness_s())},
            {"lateness_histogram", histogram(bare.lateness_s())}}},
          {"period_s", quantiles_of(ticks.period_s())},
          {"lateness_s", quantiles_of(ticks.lateness_s())},
          {"slack_s",
           {{"min", ticks.slack_s().percentile(0)},
            {"p01", ticks.slack_s().percentile(0.01)},
            {"p50", ticks.slack_s().percentile(0.5)}}},
          {"model_age_s", quantiles_of(ticks.model_age_s())},
          {"histogram_bin_s", kBinS},
          {"lateness_histogram", histogram(ticks.lateness_s())},
          {"period_histogram", histogram(ticks.period_s())}};
}

void print(const json& loop) {
  const auto us = [&](const char* what, const char* share) { return 1e6 * loop[what][share].get<double>(); };
  std::printf("%.0f s at %.2f Hz, %lu ticks; %s\n", loop["duration_s"].get<double>(),
              loop["rate_hz"].get<double>(), loop["ticks"].get<unsigned long>(),
              loop["scheduling"].get<std::string>().c_str());
  std::printf("  period    p50 %.0f us, p99 %.0f us, max %.0f us\n", us("period_s", "p50"),
              us("period_s", "p99"), us("period_s", "max"));
  std::printf("  lateness  p50 %.0f us, p99 %.0f us, max %.0f us; %lu overruns (woken > 1 ms late)\n",
              us("lateness_s", "p50"), us("lateness_s", "p99"), us("lateness_s", "max"),
              loop["overruns"].get<unsigned long>());
  const json& bare = loop["bare_timer"];
  std::printf("  a bare timer beside it: %.2f Hz, lateness p99 %.0f us, max %.0f us; %lu overruns\n",
              bare["rate_hz"].get<double>(), 1e6 * bare["lateness_s"]["p99"].get<double>(),
              1e6 * bare["lateness_s"]["max"].get<double>(), bare["overruns"].get<unsigned long>());
  std::printf("  slack     p50 %.0f us, p01 %.0f us, min %.0f us\n", us("slack_s", "p50"),
              us("slack_s", "p01"), us("slack_s", "min"));
  std::printf("  age of what is felt p99 %.1f ms; %.1f %% of a core\n",
              1e3 * loop["model_age_s"]["p99"].get<double>(),
              100 * loop["processor_s"].get<double>() / loop["duration_s"].get<double>());
}

// Share of the wake-ups that were later than so much, as a data block of gnuplot.
std::string survival(const char* name, const std::vector<std::uint64_t>& counts) {
  const auto all = static_cast<double>(std::accumulate(counts.begin(), counts.end(), std::uint64_t{0}));
  double later = all;
  std::string block = fmt::format("${} << EOD\n", name);
  for (std::size_t k = 0; k < counts.size() && later > 0; ++k) {
    block += fmt::format("{:.5f} {:.9f}\n", 1e3 * kBinS * static_cast<double>(k + 1), later / all);
    later -= static_cast<double>(counts[k]);
  }
  return block + "EOD\n";
}

void draw(const json& result, const std::string& folder) {
  std::filesystem::create_directories(folder);
  const json& loop = result.at("loop");
  plot(std::filesystem::path(folder) / "servo.png",
       survival("servo", loop.at("lateness_histogram")) +
           survival("bare", loop.at("bare_timer").at("lateness_histogram")) +
           fmt::format("set logscale xy\nset format y '10^{{%L}}'\nset xlabel 'woken later than (ms)'\n"
                       "set ylabel 'share of the ticks'\nset title '{:.0f} s, {}' noenhanced\n"
                       "plot $servo with steps lw 2 title 'servo', "
                       "$bare with steps lw 2 lc rgb '#999999' title 'bare timer'\n",
                       loop["duration_s"].get<double>(), loop["scheduling"].get<std::string>()));
}

bool run(const Arguments& arguments) {
  if (replotted(arguments.suite, "servo", draw)) return true;
  require_named(arguments.service);
  const auto channel = client::make_channel(arguments.service.address, arguments.service.tls_ca);
  if (!client::wait_connected(*channel, kConnectWaitS))
    throw BenchError(client::nobody_answers(arguments.service.address, arguments.service.tls_ca));
  const reference::TouchedTissue tissue = own_tissue();
  const auto stub = v1::Palpation::NewStub(channel);
  create_own_scene(*stub, kScene, tissue);
  json result{{"suite", "servo"}};
  result["checked"] = {
      {"against", "dense reference"},
      {"largest_relative_error", check_against_reference(channel, kScene, tissue, kIndentationM)}};
  result["loop"] = measure(arguments);
  print(result["loop"]);
  const json& loop = result["loop"];
  const bool met =
      finish(result,
             {{"allocations in the loop", loop["allocations"], 0, "1"},
              {"rate", loop["rate_hz"], kRateHz, "Hz", false},
              {"rate lost beyond a bare timer's beside it",
               loop["bare_timer"]["rate_hz"].get<double>() - loop["rate_hz"].get<double>(), kLostHz, "Hz"},
              {"telemetry dropped", loop["telemetry_dropped"], 0, "1"}},
             arguments.suite);
  if (!arguments.suite.out.empty()) draw(result, arguments.suite.out);
  return met;
}

}  // namespace

void add_servo_suite(CLI::App& app, bool& met) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command =
      *app.add_subcommand("servo", "the 1 kHz loop beside a running service: period, overruns, slack, heap");
  add_service_options(command, arguments->service);
  command.add_option("--duration-s", arguments->duration_s, "with force on")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  add_common_options(command, arguments->suite);
  command.callback([arguments, &met] { met = run(*arguments); });
}

}  // namespace teletact::bench
