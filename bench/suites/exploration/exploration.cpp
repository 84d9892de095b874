// teletact-bench exploration: the fastest finger that explores without ever waiting for the tissue ahead of
// it (T1, strategy 1), against the width of a window and the round trip between the operator and the service,
// beside which the patient side stands. The client's own window planner and arm, on simulated
// time; what the service takes from the last RF byte to a window that can be touched is given, the rest
// follows.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <memory>

#include "bench/curves.h"
#include "bench/run_suite.h"
#include "client/acquire/robot_arm.h"
#include "client/acquire/window_planner.h"

namespace teletact::bench {
namespace {

constexpr double kStepS = 0.001, kWayM = 0.6, kCompressionM = 0.0006;
constexpr double kBorderM = 0.001;     // the hand stays this far inside of what is covered
constexpr double kExploringMS = 0.12;  // (T1)
constexpr double kProbeM = 0.06;
constexpr std::size_t kQueuedUploads = 2;  // as the client's session
constexpr double kForeverS = 1e9;

struct Arguments : SuiteOptions {
  // About the 95 % of the demonstration: 385 to 446 ms on two quiet cores (README).
  double service_s = 0.41;
};

struct Exploration {
  double speed_m_s, window_m, service_s;
  client::ArmLimits arm;
  double round_trip_s =
      0;  // half of it late the patient side knows where the finger is, and it what is covered
};

// The patient side of one exploration: arm, uploads one after the other, windows published.
class PatientSide {
 public:
  PatientSide(const Exploration& of, std::size_t windows)
      : of_(of),
        planner_({.window_count = windows, .window_width_m = of.window_m}, 0, 1),
        arm_(of.arm, 0, 0),
        known_(windows, {std::nullopt, 1'000'000}),
        published_s_(windows, kForeverS) {}

  void tick(const client::FingerMotion& finger, double now_s) {
    while (!uploads_.empty() && uploads_.front() <= now_s) uploads_.pop_front();
    if (now_s < arm_.free_s() || uploads_.size() > kQueuedUploads) return;
    const auto window = planner_.next(finger, known_, now_s);
    if (!window) return;
    const client::ArmSchedule schedule = arm_.acquire(planner_.window_x_m(*window), kCompressionM, now_s);
    known_[*window].acquired_s = schedule.post_frame_s;
    service_free_s_ = std::max(service_free_s_, schedule.post_frame_s) + of_.service_s;
    uploads_.push_back(service_free_s_);
    published_s_[*window] = std::min(published_s_[*window], service_free_s_);
  }
  bool touchable(std::size_t window, double now_s) const {
    return window >= published_s_.size() || published_s_[window] <= now_s;
  }
  std::size_t window_at(double x_m) const { return planner_.window_at(x_m); }

 private:
  Exploration of_;
  client::WindowPlanner planner_;
  client::RobotArm arm_;
  std::vector<client::WindowKnowledge> known_;
  std::vector<double> published_s_;
  std::deque<double> uploads_;  // when each is done
  double service_free_s_ = 0;
};

// Whether it never waits from one end of the way to the other, once the first two windows are there, as the
// client waits for them.
bool never_waits(const Exploration& of) {
  const auto windows = static_cast<std::size_t>(std::ceil(kWayM / of.window_m));
  PatientSide patient(of, windows);
  double now_s = 0;
  const double way_s = of.round_trip_s / 2;
  while (!patient.touchable(0, now_s - way_s) || !patient.touchable(1, now_s - way_s)) {
    patient.tick({}, now_s);
    now_s += kStepS;
  }
  for (double x_m = of.window_m / 2; x_m < kWayM - kBorderM; now_s += kStepS) {
    x_m += of.speed_m_s * kStepS;
    if (!patient.touchable(patient.window_at(x_m + kBorderM), now_s - way_s)) return false;
    patient.tick({true, std::max(x_m - way_s * of.speed_m_s, of.window_m / 2), of.speed_m_s}, now_s);
  }
  return true;
}

// By bisection on the speed.
double fastest_m_s(Exploration of) {
  double low = 0.001, high = 2;
  while (high - low > 0.0005) {
    of.speed_m_s = (low + high) / 2;
    (never_waits(of) ? low : high) = of.speed_m_s;
  }
  return low;
}

struct Fastest {
  double window_m = 0, service_s = 0, speed_m_s = 0, round_trip_s = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Fastest, window_m, service_s, speed_m_s, round_trip_s)
struct Figures {
  double service_s = 0, way_m = kWayM;
  std::vector<Fastest> fastest{}, far{};  // far: windows of 60 mm, `service_s`, by round trip
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, service_s, way_m, fastest, far)

Figures measure(const Arguments& arguments, Promises& promises) {
  Figures figures{arguments.service_s};
  std::printf("fastest finger that never waits (mm/s): window (mm), then service (ms): finger\n");
  for (const double window_m : {0.02, 0.03, 0.04, 0.05, 0.06, 0.08}) {
    std::printf("  %2.0f ", 1e3 * window_m);
    for (const double service_s : {0.01, arguments.service_s, 0.5}) {
      const double speed_m_s = fastest_m_s({0, window_m, service_s, {}, 0});
      std::printf("  %3.0f: %4.0f", 1e3 * service_s, 1e3 * speed_m_s);
      figures.fastest.push_back({window_m, service_s, speed_m_s, 0});
      if (window_m == kProbeM && service_s == arguments.service_s)
        promises.push_back(
            {"fastest_finger_that_never_waits_60_mm_windows", speed_m_s, kExploringMS, "m/s", false});
    }
    std::printf("\n");
  }
  std::printf("windows of 60 mm, over a round trip of\n");
  for (const double round_trip_s : {0.0, 0.05, 0.1, 0.2, 0.3, 0.4}) {
    const double speed_m_s = fastest_m_s({0, kProbeM, arguments.service_s, {}, round_trip_s});
    std::printf("  %3.0f ms: %4.0f\n", 1e3 * round_trip_s, 1e3 * speed_m_s);
    figures.far.push_back({kProbeM, arguments.service_s, speed_m_s, round_trip_s});
  }
  return figures;
}

void draw(const Figures& figures, const std::filesystem::path& folder) {
  std::vector<Curve> curves;
  for (const Fastest& f : figures.fastest) {
    const std::string title = fmt::format("service {:.0f} ms", 1e3 * f.service_s);
    auto curve = std::find_if(curves.begin(), curves.end(), [&](const Curve& c) { return c.title == title; });
    if (curve == curves.end()) curve = curves.insert(curves.end(), {.title = title});
    curve->add(1e3 * f.window_m, 1e3 * f.speed_m_s);
  }
  plot(folder / "exploration_fastest.png",
       script_of(curves,
                 "set key top left\nset yrange [0:*]\n"
                 "set arrow from graph 0, first 120 to graph 1, first 120 nohead dt 3\n" +
                     axes("The fastest finger that never waits", "window (mm)", "finger (mm/s)")));
}

}  // namespace

void add_exploration_suite(CLI::App& app, bool& met) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command =
      add_suite(app, "exploration", "the fastest exploring finger that never waits for tissue (T1)",
                arguments, met, measure, draw);
  command
      .add_option("--service-s", arguments->service_s,
                  "from the last RF byte to a window that can be touched")
      ->check(CLI::PositiveNumber);
}

}  // namespace teletact::bench
