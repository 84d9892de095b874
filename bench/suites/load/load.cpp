// teletact-bench load: what a running service carries. Poses are meant to be sent at instants that the
// service has no say in, and their latency counts from these; several processes send them.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <fstream>
#include <iostream>
#include <memory>

#include "bench/basics/median.h"
#include "bench/curves.h"
#include "bench/imager.h"
#include "bench/load/figures.h"
#include "bench/load/processes.h"
#include "bench/load/recorded_finger.h"
#include "bench/own_scene.h"
#include "bench/run_suite.h"
#include "bench/service.h"
#include "bench/touch_client.h"

namespace teletact::bench {
namespace {

constexpr const char* kOwnScene = "bench-load";
constexpr double kCapacityWithin = 0.05;
constexpr int kMaxSteps = 12;

struct Arguments : SuiteOptions {
  Service service;
  LoadPlan plan;
  std::string loop = "paced";
  double ramp_to_hz = 0, latency_limit_s = 0;
  unsigned processes = 1, imaging = 0, own_scenes = 1;
  double image_every_s = 2, finish_within_s = 5;
  bool find_capacity = false;
};

struct Figures {
  std::vector<LoadFigures> loads;
  std::vector<WindowFigures> imaging;  // beside them
  double capacity_hz = kNan;           // answers per second to all clients; NaN: not looked for
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, loads, imaging, capacity_hz)

// Answers per second at the highest rate whose latency keeps the limit, by doubling and halving; 0: none.
double capacity_hz(LoadPlan plan, const Arguments& arguments, std::vector<LoadFigures>& loads) {
  double answers_per_s = 0;
  const auto carries = [&](double rate_hz) {
    plan.rate_hz = plan.end_rate_hz = rate_hz;
    const LoadFigures& load = loads.emplace_back(measure_load(plan, arguments.processes));
    const bool yes = carried(load, arguments.latency_limit_s);
    if (yes) answers_per_s = load.answers_per_s;
    return yes;
  };
  double good_hz = 0, bad_hz = plan.rate_hz;
  for (int k = 0; k < kMaxSteps && carries(bad_hz); ++k) good_hz = bad_hz, bad_hz *= 2;
  for (int k = 0; k < kMaxSteps && bad_hz - good_hz > kCapacityWithin * bad_hz; ++k) {
    const double middle_hz = (good_hz + bad_hz) / 2;
    (carries(middle_hz) ? good_hz : bad_hz) = middle_hz;
  }
  return answers_per_s;
}

void check(const Arguments& a) {
  if (a.find_capacity && !(a.latency_limit_s > 0))
    throw BenchError("--find-capacity needs --latency-limit-s: the latency that is to be kept");
  if (a.find_capacity && a.loop == "closed")
    throw BenchError("--find-capacity raises --rate-hz, which --loop closed does not have; leave one out");
  if (a.find_capacity && a.ramp_to_hz > 0)
    throw BenchError("--find-capacity raises the rate itself; leave out --ramp-to-hz");
  if (!a.plan.recording.empty() && (a.loop == "poisson" || a.ramp_to_hz > 0 || a.find_capacity))
    throw BenchError(
        "--recording has its own instants; leave out --loop poisson, --ramp-to-hz, --find-capacity");
  if (a.loop == "closed" && a.ramp_to_hz > 0)
    throw BenchError("--ramp-to-hz: --loop closed has no rate; leave one out");
}

// Clients that image beside the load, each into a scene of its own; it is gone with them.
class Imaging {
 public:
  Imaging(const Arguments& arguments, const std::shared_ptr<grpc::Channel>& channel)
      : stub_(v1::Palpation::NewStub(channel)) {
    if (arguments.imaging == 0) return;
    const client::Tissue tissue = imaged_tissue();
    pairs_ = imaged_pairs(tissue);
    for (unsigned k = 0; k < arguments.imaging; ++k) {
      scenes_.push_back(fmt::format("{}-imaged-{}", kOwnScene, k));
      create_imaged_scene(*stub_, scenes_.back(), tissue);
    }
    for (const std::string& scene : scenes_)
      imagers_.push_back(std::make_unique<Imager>(arguments.service, scene, scene, pairs_,
                                                  arguments.image_every_s, arguments.finish_within_s,
                                                  pause_));
  }
  // Once; prints it.
  std::vector<WindowFigures> stop() {
    std::vector<WindowFigures> out;
    for (const auto& imager : imagers_) {
      imager->stop();
      fmt::print("{}\n", line_of(out.emplace_back(imager->windows())));
    }
    imagers_.clear();
    for (const std::string& scene : scenes_) remove_scene(*stub_, scene);
    return out;
  }

 private:
  std::unique_ptr<v1::Palpation::Stub> stub_;
  std::vector<client::FramePair> pairs_;
  std::vector<std::string> scenes_;
  const Pause pause_ = false;
  std::vector<std::unique_ptr<Imager>> imagers_;
};

// With a scene to touch, which is made where none is named.
LoadPlan plan_of(const Arguments& arguments, const std::shared_ptr<grpc::Channel>& channel) {
  LoadPlan plan = arguments.plan;
  plan.address = arguments.service.address, plan.credentials = arguments.service.credentials;
  if (!plan.recording.empty()) {
    const auto recorded = read_recorded_touch(plan.recording);
    if (plan.scene_ids.empty()) plan.scene_ids = {recorded->scene_id};
    plan.rate_hz = static_cast<double>(recorded->poses.size()) / recorded->length_s;
  } else if (plan.scene_ids.empty()) {
    for (unsigned k = 0; k < arguments.own_scenes; ++k) {
      plan.scene_ids.push_back(k == 0 ? kOwnScene : fmt::format("{}-{}", kOwnScene, k));
      make_checked_scene(channel, plan.scene_ids.back(), own_tissue(), plan.indentation_m);
    }
  }
  const LoadOptions range = load_over(channel, plan.scene_ids.front());
  plan.begin_m = range.begin_m, plan.end_m = range.end_m;
  plan.closed_loop = arguments.loop == "closed", plan.poisson = arguments.loop == "poisson";
  plan.end_rate_hz = arguments.ramp_to_hz > 0 ? arguments.ramp_to_hz : plan.rate_hz;
  if (arguments.quick) plan.duration_s = std::min(plan.duration_s, 1.0), plan.warm_up_s = 0.2;
  return plan;
}

Promises promises_of(const LoadFigures& load, const std::vector<WindowFigures>& imaging,
                     double latency_limit_s) {
  double late = 0;
  for (const WindowFigures& windows : imaging) late += static_cast<double>(windows.late);
  double ended = 0;
  for (const auto* streams : {&load.tally.refused, &load.tally.failed})
    for (const auto& [status, count] : *streams) ended += static_cast<double>(count);
  return {{"latency_p99_bound", load.p99_bound_s, latency_limit_s, "s"},
          {"poses_answered", answered_share(load), kAnswered, "", false},
          {"streams_refused_or_failed", ended, 0},
          {"windows_neither_in_time_nor_refused_at_once", late, 0}};
}

Figures measure(const Arguments& arguments, Promises& promises) {
  check(arguments);
  const auto channel = connect(arguments.service);
  const LoadPlan plan = plan_of(arguments, channel);
  Imaging imaging(arguments, channel);
  Figures figures;
  if (arguments.find_capacity) {
    figures.capacity_hz = capacity_hz(plan, arguments, figures.loads);
    fmt::print("capacity: {:.0f} answers/s to {} clients with the p99 within {:.3f} ms\n",
               figures.capacity_hz, plan.clients, 1e3 * arguments.latency_limit_s);
  } else {
    figures.loads.push_back(measure_load(plan, arguments.processes));
  }
  figures.imaging = imaging.stop();
  if (arguments.latency_limit_s > 0 && !arguments.find_capacity)
    promises = promises_of(figures.loads.back(), figures.imaging, arguments.latency_limit_s);
  return figures;
}

void draw(const Figures& figures, const std::filesystem::path& folder) {
  Curve median{.title = "p50", .style = "linespoints"}, tail{.title = "p99", .style = "linespoints"};
  std::vector<LoadFigures> loads = figures.loads;
  std::sort(loads.begin(), loads.end(),
            [](const LoadFigures& a, const LoadFigures& b) { return a.intended_per_s < b.intended_per_s; });
  for (const LoadFigures& c : loads) {
    median.add(c.intended_per_s, 1e3 * c.p50_s);
    tail.add(c.intended_per_s, 1e3 * c.p99_s);
  }
  plot(folder / "load.png", script_of({median, tail}, "set logscale y\nset key top left\n" +
                                                          axes("what a service carries", "poses per second",
                                                               "latency from the meant instant (ms)")));
}

void add_rate_options(CLI::App& command, Arguments& a) {
  command
      .add_option("--loop", a.loop,
                  "paced, poisson: instants that no answer changes; closed: one pose after the other")
      ->check(CLI::IsMember({"paced", "poisson", "closed"}));
  command.add_option("--rate-hz", a.plan.rate_hz, "poses per second of each client")
      ->check(CLI::PositiveNumber);
  command.add_option("--ramp-to-hz", a.ramp_to_hz, "the rate at the end, where it is to change evenly")
      ->check(CLI::PositiveNumber);
  command
      .add_option("--in-flight", a.plan.in_flight,
                  "poses of a client without an answer; what is meant beyond is held back, and counted")
      ->check(CLI::Range(1, 256));
  command.add_flag("--greedy", a.plan.greedy,
                   "clients send at once, even while the service says that it answers more seldom");
  command.add_flag("--laws", a.plan.laws, "clients ask for contact laws");
  command.add_flag("--find-capacity", a.find_capacity,
                   "double the rate, then halve the step, until --latency-limit-s is met within 5 %");
  command.add_option("--latency-limit-s", a.latency_limit_s, "for the p99, with a confidence of 99 %")
      ->check(CLI::PositiveNumber);
}

void add_stream_options(CLI::App& command, Arguments& a) {
  command.add_option("--clients", a.plan.clients, "touch streams at once")->check(CLI::Range(1, 100000));
  command.add_option("--processes", a.processes, "that share the clients")->check(CLI::Range(1, 256));
  command
      .add_option("--stay-s", a.plan.stay_s, "of a stream on average (exponential), then another is opened")
      ->check(CLI::PositiveNumber);
  command.add_option("--cancel-share", a.plan.cancel_share, "of the streams that go: dropped as they stand")
      ->check(CLI::Range(0.0, 1.0));
  command.add_option("--duration-s", a.plan.duration_s, "of each load")->check(CLI::PositiveNumber);
  command.add_option("--warm-up-s", a.plan.warm_up_s, "before it, not counted")
      ->check(CLI::NonNegativeNumber);
  command.add_option("--seed", a.plan.seed);
}

}  // namespace

void add_load_suite(CLI::App& app, bool& met) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command = add_suite(app, "load", "what a running service carries, and how late it then is",
                                arguments, met, measure, draw);
  add_service_options(command, arguments->service);
  command.add_option("--scene", arguments->plan.scene_ids,
                     "a scene to touch, or several, in turn; without it the suite makes its own");
  command.add_option("--own-scenes", arguments->own_scenes, "that the suite makes without --scene")
      ->check(CLI::Range(1, 64));
  command.add_option("--recording", arguments->plan.recording,
                     "of touch --record: what every client does, over and over, at its own instants");
  command.add_option("--imaging", arguments->imaging, "clients that publish windows beside the load")
      ->check(CLI::Range(1, 64));
  command.add_option("--image-every-s", arguments->image_every_s, "a window of each of them")
      ->check(CLI::PositiveNumber);
  command.add_option("--finish-within-s", arguments->finish_within_s, "its deadline, after the last RF byte")
      ->check(CLI::PositiveNumber);
  add_rate_options(command, *arguments);
  add_stream_options(command, *arguments);
}

void add_load_worker(CLI::App& app) {
  const auto file = std::make_shared<std::string>();
  CLI::App& command = *app.add_subcommand(kLoadWorker)->group("");  // not for people: a process of `load`
  command.add_option("plan", *file)->required();
  command.callback([file] {
    std::ifstream in(*file);
    std::cout << nlohmann::json(run_worker(nlohmann::json::parse(in).get<LoadPlan>())) << std::endl;
  });
}

}  // namespace teletact::bench
