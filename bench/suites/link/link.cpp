// teletact-bench link: a whole session of touching at 120 mm/s with a link between it and a running service,
// one factor at a time: round trip, jitter, rate. A proxy of the suite's own delays what passes, so that the
// service has to be on this machine.
//
// The suite touches a scene of its own, whose forces are first checked against the dense reference (T4.1).
#include <fmt/format.h>

#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cstdio>
#include <iterator>
#include <memory>

#include "bench/curves.h"
#include "bench/own_scene.h"
#include "bench/service.h"
#include "bench/suite.h"
#include "client/session/operator_session.h"
#include "tests/support/fault_proxy.h"

namespace teletact::bench {
namespace {

constexpr double kSecondsS = 6, kQuickS = 2, kSpeedMS = 0.12, kIndentationM = 0.004, kPeriodS = 0.002;
constexpr const char* kScene = "bench-link";
constexpr double kMbit = 1e6, kNarrowBits = 64e3;

struct Arguments : SuiteOptions {
  Service service;
};

// What the proxy adds, both ways alike.
struct Condition {
  const char* name;
  double round_trip_s;
  double jitter_share = 0;  // of the round trip, +- : evenly
  double bits_s = 0;        // each way; 0: not limited
  unsigned credit = client::Pacing::kMost;
};
constexpr std::array kConditions{Condition{"0 ms", 0},
                                 Condition{"50 ms", 0.05},
                                 Condition{"100 ms", 0.1},
                                 Condition{"200 ms", 0.2},
                                 Condition{"300 ms", 0.3},
                                 Condition{"100 ms +- 30 %", 0.1, 0.3},
                                 Condition{"100 ms, 1 Mbit/s", 0.1, 0, kMbit},
                                 Condition{"100 ms, 64 kbit/s, one at a time", 0.1, 0, kNarrowBits, 1},
                                 Condition{"100 ms, 64 kbit/s", 0.1, 0, kNarrowBits}};

struct Touched {
  std::string name;
  double round_trip_s = 0, jitter_share = 0, bits_s = 0;
  double answers_per_s = 0;  // to distinct poses
  double enabled_s = 0, faded_s = 0, lost_s = 0, degraded_s = 0;
  double age_p50_s = 0, age_p95_s = 0;              // of an answer when it arrives
  double measured_round_trip_s = 0;                 // p50, less what the service took
  double up_bytes_per_s = 0, down_bytes_per_s = 0;  // of the whole connection
  double largest_force_n = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Touched, name, round_trip_s, jitter_share, bits_s, answers_per_s,
                                   enabled_s, faded_s, lost_s, degraded_s, age_p50_s, age_p95_s,
                                   measured_round_trip_s, up_bytes_per_s, down_bytes_per_s, largest_force_n)
struct Figures {
  Checked checked;
  double speed_m_s = kSpeedMS, period_s = kPeriodS;
  std::vector<Touched> touched{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, checked, speed_m_s, period_s, touched)

Touched touch(const Arguments& arguments, const Condition& condition) {
  test::FaultProxy proxy(arguments.service.address);
  const double way_s = condition.round_trip_s / 2, jitter_s = condition.jitter_share * condition.round_trip_s;
  const test::DirectionFaults way{
      .delay_s = way_s - jitter_s / 2, .jitter_s = jitter_s, .bandwidth_bytes_s = condition.bits_s / 8};
  proxy.play({.faults = {way, way}});
  client::OperatorSessionOptions session;
  session.address = proxy.address();
  session.tls_ca = arguments.service.tls_ca;
  session.open.set_scene_id(kScene);
  session.open.set_period_s(kPeriodS);
  session.open.set_credit(condition.credit);
  session.hand.indentation_m = kIndentationM;
  session.hand.speed_m_s = kSpeedMS;
  session.duration_s = arguments.quick ? kQuickS : kSecondsS;
  session.wait_s = 20;  // a narrow link takes long to say what the scene is
  const std::atomic<bool> stop{false};
  const client::TouchSummary summary = client::run_operator_session(session, stop);
  const client::TickStatistics& ticks = summary.ticks;
  const client::TouchLinkStats& link = summary.link;
  const double span_s = link.last_answer_s - link.first_answer_s;
  return {condition.name,
          condition.round_trip_s,
          condition.jitter_share,
          condition.bits_s,
          span_s > 0 ? static_cast<double>(link.distinct) / span_s : 0,
          ticks.enabled_s(),
          ticks.faded().seconds(),
          ticks.lost_s(),
          ticks.degraded().seconds(),
          link.latencies_s.percentile(0.5),
          link.latencies_s.percentile(0.95),
          link.round_trips_s.percentile(0.5),
          static_cast<double>(proxy.bytes_up()) / span_s,
          static_cast<double>(proxy.bytes_down()) / span_s,
          ticks.largest_force_n()};
}

// A narrow link may add so much to the age of a lone answer.
void promise_narrow(const Touched& t, const Touched& lone, Promises& promises) {
  const std::string name = snake_case(t.name) + "_";
  promises.push_back({name + "answers", t.answers_per_s, 8, "1/s", false});
  promises.push_back({name + "age_beyond_a_lone_answers_p50", t.age_p50_s - lone.age_p50_s, 0.1, "s"});
  promises.push_back({name + "age_beyond_a_lone_answers_p95", t.age_p95_s - lone.age_p50_s, 0.25, "s"});
}

void promise_wide(const Touched& t, Promises& promises) {
  constexpr double kDegradedS = 0.25;  // an older model is (T5.6b)
  const std::string name = snake_case(t.name) + "_";
  promises.push_back({name + "answers", t.answers_per_s, 0.5 / kPeriodS, "1/s", false});
  promises.push_back({name + "faded", t.faded_s, 0, "s"});
  promises.push_back({name + "lost", t.lost_s, 0, "s"});
  if (t.round_trip_s < kDegradedS) promises.push_back({name + "degraded", t.degraded_s, 0, "s"});
  promises.push_back(
      {name + "age_beyond_the_round_trip_p50", t.age_p50_s - t.round_trip_s, 2 * kPeriodS, "s"});
}

Figures measure(const Arguments& arguments, Promises& promises) {
  const auto channel = connect(arguments.service);
  spdlog::set_level(spdlog::level::err);  // what a session says of its link is in the table
  Figures figures{make_checked_scene(channel, kScene, own_tissue(), kIndentationM)};
  std::printf("%-34s answers/s  faded s  lost s  DEGRADED s  age p50 ms  p95 ms  up kB/s  down kB/s  N\n",
              "link");
  for (const Condition& condition : kConditions) {
    const Touched& t = figures.touched.emplace_back(touch(arguments, condition));
    std::printf("%-34s %9.0f %8.2f %7.2f %11.2f %11.1f %7.1f %8.1f %10.1f  %.3f\n", t.name.c_str(),
                t.answers_per_s, t.faded_s, t.lost_s, t.degraded_s, 1e3 * t.age_p50_s, 1e3 * t.age_p95_s,
                1e-3 * t.up_bytes_per_s, 1e-3 * t.down_bytes_per_s, t.largest_force_n);
    if (t.jitter_share == 0 && t.bits_s == 0) promise_wide(t, promises);
  }
  promise_narrow(figures.touched.back(), *std::prev(figures.touched.end(), 2), promises);
  return figures;
}

void draw(const Figures& figures, const std::filesystem::path& folder) {
  Curve answers{.title = "answers per second", .ours = true}, faded{.title = "time faded (%)"},
      aged{.title = "age beyond the round trip, 95 % (ms)"};
  for (const Touched& t : figures.touched) {
    if (t.jitter_share > 0 || t.bits_s > 0) continue;
    answers.add(1e3 * t.round_trip_s, t.answers_per_s);
    faded.add(1e3 * t.round_trip_s, t.enabled_s > 0 ? 100 * t.faded_s / t.enabled_s : 100);
    aged.add(1e3 * t.round_trip_s, 1e3 * (t.age_p95_s - t.round_trip_s));
  }
  plot(folder / "link.png",
       script_of({answers, faded, aged},
                 "set yrange [0:*]\nset key center right\n" +
                     axes("Touch at 120 mm/s over a constant round trip", "round trip (ms)", "")));
}

}  // namespace

void add_link_suite(CLI::App& app, bool& met) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command = add_suite(app, "link", "touch over long and narrow links: answers, fading, age",
                                arguments, met, measure, draw);
  add_service_options(command, arguments->service);
}

}  // namespace teletact::bench
