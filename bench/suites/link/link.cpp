// teletact-bench link: a whole session of touching at 120 mm/s with a link between it and a running service,
// one factor at a time: round trip, jitter, stalls, rate; by the contact law and by answers alone. A proxy of
// the suite's own delays what passes, so that the service has to be on this machine.
//
// The suite touches a scene of its own, whose forces are first checked against the dense reference (T4.1).
// What is felt is judged against the exact force of the same model at the same poses.
#include <fmt/format.h>

#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cstdio>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "bench/curves.h"
#include "bench/own_scene.h"
#include "bench/run_suite.h"
#include "bench/service.h"
#include "bench/suites/link/felt.h"
#include "client/session/operator_session.h"
#include "tests/files/temporary_folder.h"
#include "tests/support/fault_proxy.h"

namespace teletact::bench {
namespace {

constexpr double kSecondsS = 6, kQuickS = 2, kSpeedMS = 0.12, kIndentationM = 0.004, kPeriodS = 0.002;
constexpr const char* kScene = "bench-link";
constexpr double kElementM = 0.001;  // the usual tip touches several
constexpr double kMbit = 1e6, kNarrowBits = 64e3;
constexpr double kFarthestS = 0.3;  // of round trips that something is promised of
constexpr const char* kLone = "100 ms, 64 kbit/s, one at a time";

struct Arguments : SuiteOptions {
  Service service;
};

// What the proxy adds, both ways alike.
struct Condition {
  const char* name;
  double round_trip_s;
  double jitter_share = 0;  // of the round trip, +- : evenly
  double bits_s = 0;        // each way; 0: not limited
  bool stalls = false;      // of 200 ms, in a tenth of the time
  unsigned credit = client::Pacing::kMax;
};
constexpr std::array kConditions{
    Condition{.name = "0 ms", .round_trip_s = 0},
    Condition{.name = "50 ms", .round_trip_s = 0.05},
    Condition{.name = "100 ms", .round_trip_s = 0.1},
    Condition{.name = "200 ms", .round_trip_s = 0.2},
    Condition{.name = "300 ms", .round_trip_s = 0.3},
    Condition{.name = "400 ms", .round_trip_s = 0.4},
    Condition{.name = "100 ms +- 30 %", .round_trip_s = 0.1, .jitter_share = 0.3},
    Condition{.name = "0 ms, stalls", .round_trip_s = 0, .stalls = true},
    Condition{.name = "100 ms, stalls", .round_trip_s = 0.1, .stalls = true},
    Condition{.name = "100 ms, 10 Mbit/s", .round_trip_s = 0.1, .bits_s = 10 * kMbit},
    Condition{.name = "100 ms, 1 Mbit/s", .round_trip_s = 0.1, .bits_s = kMbit},
    Condition{.name = "100 ms, 64 kbit/s", .round_trip_s = 0.1, .bits_s = kNarrowBits},
    Condition{.name = kLone, .round_trip_s = 0.1, .bits_s = kNarrowBits, .credit = 1}};

struct Touched {
  std::string name, renderer;
  double round_trip_s = 0, jitter_share = 0, bits_s = 0;
  bool stalls = false;
  double answers_per_s = 0;  // from half a second after force came on
  double enabled_s = 0, faded_s = 0, lost_s = 0, degraded_s = 0;
  double age_p50_s = 0, age_p95_s = 0;              // of an answer when it arrives
  double measured_round_trip_s = 0;                 // p50, less what the service took
  double up_bytes_per_s = 0, down_bytes_per_s = 0;  // of the whole connection
  double largest_force_n = 0;
  double within_half = 0, within_one = 0, error_p50 = 0, error_p95 = 0, lag_s = 0;  // felt.h
  double by_law_share = 0, min_energy_j = 0, law_after_s = 0;
  double bytes_per_s() const { return up_bytes_per_s + down_bytes_per_s; }
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Touched, name, renderer, round_trip_s, jitter_share, bits_s, stalls,
                                   answers_per_s, enabled_s, faded_s, lost_s, degraded_s, age_p50_s,
                                   age_p95_s, measured_round_trip_s, up_bytes_per_s, down_bytes_per_s,
                                   largest_force_n, within_half, within_one, error_p50, error_p95, lag_s,
                                   by_law_share, min_energy_j, law_after_s)
struct Figures {
  Checked checked;
  double speed_m_s = kSpeedMS, period_s = kPeriodS;
  std::vector<Touched> touched{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, checked, speed_m_s, period_s, touched)

std::vector<test::FaultEvent> schedule_of(const Condition& condition, double seconds) {
  constexpr double kStallS = 0.2, kEveryS = 2;
  const double way_s = condition.round_trip_s / 2, jitter_s = condition.jitter_share * condition.round_trip_s;
  const test::DirectionFaults way{
      .delay_s = way_s - jitter_s / 2, .jitter_s = jitter_s, .bandwidth_bytes_s = condition.bits_s / 8};
  std::vector<test::FaultEvent> schedule{{.faults = {way, way}}};
  if (condition.stalls)
    for (double at_s = kEveryS; at_s < 2 * seconds; at_s += kEveryS)
      schedule.push_back(
          {.at_s = at_s, .kind = test::FaultEvent::Kind::kStall, .seconds = kStallS, .faults = {}});
  return schedule;
}

Touched touch(const Arguments& arguments, const Condition& condition, const std::string& renderer,
              const reference::TouchedTissue& tissue) {
  const double seconds = arguments.quick ? kQuickS : kSecondsS;
  test::FaultProxy proxy(arguments.service.address);
  proxy.play(schedule_of(condition, seconds));
  client::OperatorSessionOptions session;
  session.address = proxy.address();
  session.credentials = arguments.service.credentials;
  session.open.set_scene_id(kScene);
  session.open.set_period_s(kPeriodS);
  session.open.set_credit(condition.credit);
  session.hand.indentation_m = kIndentationM;
  session.hand.speed_m_s = kSpeedMS;
  session.renderer = renderer;
  session.duration_s = seconds;
  session.wait_s = 20;  // a narrow link takes long to say what the scene is
  const client::TemporaryFolder folder;
  session.record_path = folder / "record";
  const std::atomic<bool> stop{false};
  const client::TouchSummary summary = client::run_operator_session(session, stop);
  const client::TickStatistics& ticks = summary.ticks;
  const client::TouchLinkStats& link = summary.link;
  const double span_s = link.last_answer_s - link.first_answer_s;
  const Felt felt = felt_in(session.record_path, tissue);
  return {condition.name,
          renderer,
          condition.round_trip_s,
          condition.jitter_share,
          condition.bits_s,
          condition.stalls,
          felt.answers_per_s,
          ticks.enabled_s(),
          ticks.faded().seconds(),
          ticks.lost_s(),
          ticks.degraded().seconds(),
          link.latencies_s.percentile(0.5),
          link.latencies_s.percentile(0.95),
          link.round_trips_s.percentile(0.5),
          static_cast<double>(proxy.bytes_up()) / span_s,
          static_cast<double>(proxy.bytes_down()) / span_s,
          ticks.largest_force_n(),
          felt.within_half,
          felt.within_one,
          felt.error_p50,
          felt.error_p95,
          felt.lag_s,
          felt.by_law_share,
          felt.min_energy_j,
          felt.law_after_s};
}

// Without a law. A narrow link may add so much to the age of a lone answer.
void promise_narrow(const Touched& t, const Touched& lone, Promises& promises) {
  const std::string name = snake_case(t.name + " " + t.renderer) + "_";
  promises.push_back({name + "answers", t.answers_per_s, 8, "1/s", false});
  promises.push_back({name + "age_beyond_a_lone_answers_p50", t.age_p50_s - lone.age_p50_s, 0.1, "s"});
  promises.push_back({name + "age_beyond_a_lone_answers_p95", t.age_p95_s - lone.age_p50_s, 0.25, "s"});
}

void promise_wide(const Touched& t, Promises& promises) {
  constexpr double kDegradedS = 0.25;  // an older model is (T5.6b)
  const std::string name = snake_case(t.name + " " + t.renderer) + "_";
  promises.push_back({name + "answers", t.answers_per_s, 0.5 / kPeriodS, "1/s", false});
  promises.push_back({name + "faded", t.faded_s, 0, "s"});
  promises.push_back({name + "lost", t.lost_s, 0, "s"});
  if (t.round_trip_s < kDegradedS) promises.push_back({name + "degraded", t.degraded_s, 0, "s"});
  promises.push_back(
      {name + "age_beyond_the_round_trip_p50", t.age_p50_s - t.round_trip_s, 2 * kPeriodS, "s"});
}

constexpr double kLongestFirstS = 0.2;
// Beyond three round trips.
double law_after(const Touched& t) {
  return t.law_after_s < 0 ? std::numeric_limits<double>::infinity() : t.law_after_s - 3 * t.round_trip_s;
}

// By the contact law: whatever the round trip, and stalls too, where those are not much longer than it fades.
void promise_law(const Touched& t, Promises& promises) {
  constexpr double kChecksPerS = 20, kOff = 0.1, kMaxBytesPerS = 20e3;
  const std::string name = snake_case(t.name + " " + t.renderer) + "_";
  promises.push_back({name + "law_after_three_round_trips_and", law_after(t), kLongestFirstS, "s"});
  promises.push_back({name + "within_half_a_percent", t.within_half, 0.95, "of ticks", false});
  promises.push_back({name + "within_one_percent", t.within_one, 0.99, "of ticks", false});
  promises.push_back({name + "faded", t.faded_s, 0, "s"});
  promises.push_back({name + "lost", t.lost_s, 0, "s"});
  promises.push_back({name + "degraded", t.degraded_s, 0, "s"});
  if (t.stalls) return;
  promises.push_back({name + "answers", t.answers_per_s, (1 - kOff) * kChecksPerS, "1/s", false});
  promises.push_back({name + "answers_no_more", t.answers_per_s, (1 + kOff) * kChecksPerS, "1/s"});
  promises.push_back({name + "bytes", t.bytes_per_s(), kMaxBytesPerS, "B/s"});
}

Figures measure(const Arguments& arguments, Promises& promises) {
  const auto channel = connect(arguments.service);
  spdlog::set_level(spdlog::level::err);  // what a session says of its link is in the table
  const reference::TouchedTissue tissue = own_tissue(kElementM);
  Figures figures{make_checked_scene(channel, kScene, tissue, kIndentationM)};
  std::printf(
      "%-34s %-12s answers/s  faded s  lost s  DEGRADED s  age p50 ms  p95 ms  kB/s  in 0.5 %%  in 1 %%  p95 "
      "%%  lag ms  by law  law after ms\n",
      "link", "renderer");
  for (const Condition& condition : kConditions) {
    std::vector<std::string> renderers{"law", "kalman"};
    if (condition.credit == 1) renderers = {"kalman"};
    for (const std::string& renderer : renderers) {
      const Touched& t = figures.touched.emplace_back(touch(arguments, condition, renderer, tissue));
      std::printf(
          "%-34s %-12s %9.0f %8.2f %7.2f %11.2f %11.1f %7.1f %5.1f %9.2f %7.2f %6.1f %7.0f %7.3f %8.0f\n",
          t.name.c_str(), renderer.c_str(), t.answers_per_s, t.faded_s, t.lost_s, t.degraded_s,
          1e3 * t.age_p50_s, 1e3 * t.age_p95_s, 1e-3 * t.bytes_per_s(), 100 * t.within_half,
          100 * t.within_one, 100 * t.error_p95, 1e3 * t.lag_s, t.by_law_share, 1e3 * t.law_after_s);
      std::fflush(stdout);
    }
  }
  const auto lone = std::find_if(figures.touched.begin(), figures.touched.end(),
                                 [](const Touched& t) { return t.name == kLone; });
  for (const Touched& t : figures.touched) {
    const bool narrow = t.bits_s == kNarrowBits;
    if (t.renderer == "law" && !narrow && t.round_trip_s <= kFarthestS) promise_law(t, promises);
    if (t.renderer == "kalman" && t.jitter_share == 0 && t.bits_s == 0 && !t.stalls)
      promise_wide(t, promises);
    if (narrow && t.name != kLone) promise_narrow(t, *lone, promises);
    if (narrow && t.renderer == "law")
      promises.push_back(
          {snake_case(t.name) + "_law_after_three_round_trips_and", law_after(t), kLongestFirstS, "s"});
  }
  return figures;
}

void draw(const Figures& figures, const std::filesystem::path& folder) {
  std::vector<Curve> curves;
  for (const char* renderer : {"law", "kalman"}) {
    Curve& curve = curves.emplace_back(Curve{.title = renderer, .ours = curves.empty()});
    for (const Touched& t : figures.touched)
      if (t.renderer == renderer && t.jitter_share == 0 && t.bits_s == 0 && !t.stalls)
        curve.add(1e3 * t.round_trip_s, 100 * t.error_p95);
  }
  plot(folder / "link.png", script_of(curves, "set logscale y\nset key center right\n" +
                                                  axes("Force felt at 120 mm/s over a constant round trip",
                                                       "round trip (ms)", "error, 95 % of the time (%)")));
}

}  // namespace

void add_link_suite(CLI::App& app, bool& met) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command =
      add_suite(app, "link", "touch over long and narrow links: force error, answers, fading, age", arguments,
                met, measure, draw);
  add_service_options(command, arguments->service);
}

}  // namespace teletact::bench
