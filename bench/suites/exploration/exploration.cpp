// teletact-bench exploration: how often a finger that explores waits for the tissue ahead of it (T1, strategy
// 1), against its speed and the width of a window, and the fastest finger that never waits. The client's own
// window planner and arm, on simulated time; what the service takes from the last RF byte to a window that
// can be touched is given, the rest follows.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <memory>

#include "bench/suite.h"
#include "client/acquire/robot_arm.h"
#include "client/acquire/window_planner.h"

namespace teletact::bench {
namespace {

using nlohmann::json;

constexpr double kStepS = 0.001, kWayM = 0.6, kCompressionM = 0.0006;
constexpr double kBorderM = 0.001;     // the hand stays this far inside of what is covered
constexpr double kExploringMS = 0.12;  // (T1)
constexpr double kProbeM = 0.06;
constexpr std::size_t kQueuedUploads = 2;  // as the client's session
constexpr double kForeverS = 1e9;

struct Arguments {
  SuiteOptions suite;
  // The demonstration's 95 %: 327 to 409 ms on two quiet cores (README).
  double service_s = 0.41;
};

struct Exploration {
  double speed_m_s, window_m, service_s;
  client::ArmLimits arm;
};

struct Stalls {
  std::size_t count = 0;
  double seconds = 0, whole_s = 0;
  double share() const { return seconds / whole_s; }
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

// From one end of the way to the other, once the first two windows are there, as the client waits for them.
Stalls explore(const Exploration& of) {
  const auto windows = static_cast<std::size_t>(std::ceil(kWayM / of.window_m));
  PatientSide patient(of, windows);
  double now_s = 0, x_m = of.window_m / 2;
  while (!patient.touchable(0, now_s) || !patient.touchable(1, now_s)) {
    patient.tick({}, now_s);
    now_s += kStepS;
  }
  Stalls stalls;
  bool held = false;
  const double begin_s = now_s;
  for (; x_m < kWayM - kBorderM; now_s += kStepS) {
    const double next_m = x_m + of.speed_m_s * kStepS;
    const bool free = patient.touchable(patient.window_at(next_m + kBorderM), now_s);
    if (free) x_m = next_m;
    if (!free) stalls.seconds += kStepS;
    if (!free && !held) ++stalls.count;
    held = !free;
    patient.tick({true, x_m, free ? of.speed_m_s : 0}, now_s);
  }
  stalls.whole_s = now_s - begin_s;
  return stalls;
}

// By bisection on the speed.
double fastest_m_s(Exploration of) {
  double low = 0.001, high = 2;
  while (high - low > 0.0005) {
    of.speed_m_s = (low + high) / 2;
    (explore(of).count == 0 ? low : high) = of.speed_m_s;
  }
  return low;
}

std::vector<double> windows_m() {
  return {0.02, 0.03, 0.04, 0.05, 0.06, 0.08};
}

json measure(const Arguments& arguments, std::vector<Target>& targets) {
  const std::vector<double> services_s{0.01, 0.1, arguments.service_s, 0.5};
  json fastest = json::array(), stalls = json::array();
  std::printf("fastest finger that never waits (mm/s): window (mm), then service (ms): finger\n");
  for (const double window_m : windows_m()) {
    std::printf("  %2.0f ", 1e3 * window_m);
    for (const double service_s : services_s) {
      const double speed_m_s = fastest_m_s({0, window_m, service_s, {}});
      std::printf("  %3.0f: %4.0f", 1e3 * service_s, 1e3 * speed_m_s);
      fastest.push_back({{"window_m", window_m}, {"service_s", service_s}, {"speed_m_s", speed_m_s}});
      if (window_m == kProbeM && service_s == arguments.service_s)
        targets.push_back({"exploration: fastest finger that never waits, 60 mm windows", speed_m_s,
                           kExploringMS, "m/s", false});
    }
    std::printf("\n");
    for (double speed_m_s = 0.02; speed_m_s <= 0.4001; speed_m_s += arguments.suite.quick ? 0.1 : 0.01) {
      const Stalls s = explore({speed_m_s, window_m, arguments.service_s, {}});
      stalls.push_back({{"window_m", window_m},
                        {"speed_m_s", speed_m_s},
                        {"stalls", s.count},
                        {"stalled_s", s.seconds},
                        {"share", s.share()}});
    }
  }
  return {{"suite", "exploration"},
          {"service_s", arguments.service_s},
          {"way_m", kWayM},
          {"fastest", fastest},
          {"stalls", stalls}};
}

void draw_stalls(const json& result, const std::filesystem::path& file) {
  std::string script, curves;
  for (const double window_m : windows_m()) {
    const std::string name = fmt::format("$w{:.0f}", 1e3 * window_m);
    script += name + " << EOD\n";
    for (const json& row : result.at("stalls"))
      if (row["window_m"] == window_m)
        script +=
            fmt::format("{} {}\n", 1e3 * row["speed_m_s"].get<double>(), 100 * row["share"].get<double>());
    script += "EOD\n";
    curves += fmt::format("{}{} with lines lw 2 title '{:.0f} mm'", curves.empty() ? "" : ", ", name,
                          1e3 * window_m);
  }
  plot(file,
       script +
           fmt::format("set title 'Time that an exploring finger waits, service {:.0f} ms'\n",
                       1e3 * result.at("service_s").get<double>()) +
           "set xlabel 'finger (mm/s)'\nset ylabel 'share of the time (%)'\nset key top left title 'window'\n"
           "set arrow from 120, graph 0 to 120, graph 1 nohead dt 3\nplot " +
           curves + "\n");
}

void draw_fastest(const json& result, const std::filesystem::path& file) {
  std::string script, curves;
  std::vector<double> services_s;
  for (const json& row : result.at("fastest"))
    if (std::find(services_s.begin(), services_s.end(), row["service_s"].get<double>()) == services_s.end())
      services_s.push_back(row["service_s"]);
  for (std::size_t k = 0; k < services_s.size(); ++k) {
    script += fmt::format("$s{} << EOD\n", k);
    for (const json& row : result.at("fastest"))
      if (row["service_s"] == services_s[k])
        script +=
            fmt::format("{} {}\n", 1e3 * row["window_m"].get<double>(), 1e3 * row["speed_m_s"].get<double>());
    script += "EOD\n";
    curves += fmt::format("{}$s{} with linespoints lw 2 title 'service {:.0f} ms'", k == 0 ? "" : ", ", k,
                          1e3 * services_s[k]);
  }
  plot(file,
       script +
           "set title 'The fastest finger that never waits'\nset xlabel 'window (mm)'\nset ylabel 'finger "
           "(mm/s)'\nset key top left\nset yrange [0:*]\nset arrow from graph 0, first 120 to graph 1, first "
           "120 nohead dt 3\nplot " +
           curves + "\n");
}

void draw(const json& result, const std::string& folder) {
  std::filesystem::create_directories(folder);
  draw_stalls(result, std::filesystem::path(folder) / "exploration_stalls.png");
  draw_fastest(result, std::filesystem::path(folder) / "exploration_fastest.png");
}

bool run(const Arguments& arguments) {
  if (replotted(arguments.suite, "exploration", draw)) return true;
  std::vector<Target> targets;
  json result = measure(arguments, targets);
  const bool met = finish(result, targets, arguments.suite);
  if (!arguments.suite.out.empty()) draw(result, arguments.suite.out);
  return met;
}

}  // namespace

void add_exploration_suite(CLI::App& app, bool& met) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command = *app.add_subcommand(
      "exploration", "how often an exploring finger waits for tissue, and the fastest that never does (T1)");
  command
      .add_option("--service-s", arguments->service_s,
                  "from the last RF byte to a window that can be touched")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  add_common_options(command, arguments->suite);
  command.callback([arguments, &met] { met = run(*arguments); });
}

}  // namespace teletact::bench
