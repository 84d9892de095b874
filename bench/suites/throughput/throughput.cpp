// teletact-bench throughput: touches per second and latency of a running service, closed and open loop; the
// suite `load` in its usual form.
//
// Before timing, answers are checked: on the suite's own scene against the dense reference (T4.1) of the same
// grid and modulus; on a given scene, whose tissue is unknown here, the force against the slope of the energy
// (T4.5).
#include <fmt/format.h>
#include <grpcpp/grpcpp.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>

#include "bench/curves.h"
#include "bench/load/figures.h"
#include "bench/own_scene.h"
#include "bench/run_suite.h"
#include "bench/service.h"
#include "bench/touch_client.h"
#include "client/acquire/estimate_client.h"

namespace teletact::bench {
namespace {

// What a single operator is promised on two processor cores.
constexpr double kTouchesPerS = 200, kLatencyS = 0.010;
constexpr double kWarmUpS = 0.2;
constexpr double kSlopeTolerance = 2e-2;  // central difference of the energy over 0.2 mm
constexpr const char* kOwnScene = "bench-throughput";

struct Arguments : SuiteOptions {
  Service service;
  std::string scene_id;
  unsigned clients = 1;
  double duration_s = 5, open_loop_hz = 500;
};

// Largest relative difference of the force from -dU/dy.
double check_energy_slope(const std::shared_ptr<grpc::Channel>& channel, const std::string& scene_id,
                          const LoadOptions& load) {
  constexpr double kStepM = 1e-4;
  const double y_m = load.indentation_m;
  return largest_error("its energy's slope", kSlopeTolerance, {0.2, 0.5, 0.8}, [&](double share) {
    const double x_m = load.begin_m + share * (load.end_m - load.begin_m);
    const auto at = [&](double indentation_m) { return touch_once(channel, scene_id, x_m, indentation_m); };
    const double slope = (at(y_m + kStepM).energy_j() - at(y_m - kStepM).energy_j()) / (2 * kStepM);
    return std::abs(-slope - at(y_m).force_n(1)) / std::abs(slope);
  });
}

struct ServiceFigures {
  std::string build, api, device, driver_version, grpc;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ServiceFigures, build, api, device, driver_version, grpc)
struct Figures {
  ServiceFigures service;
  unsigned clients = 0;
  Checked checked;
  LoadFigures closed_loop, open_loop;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, service, clients, checked, closed_loop, open_loop)

LoadFigures run_clients(const Arguments& arguments, const LoadOptions& load, double rate_hz) {
  LoadPlan plan{.address = arguments.service.address,
                .scene_ids = {load.scene_id},
                .credentials = arguments.service.credentials,
                .begin_m = load.begin_m,
                .end_m = load.end_m,
                .indentation_m = load.indentation_m,
                .speed_m_s = load.speed_m_s,
                .recording = {}};
  plan.clients = arguments.clients;
  plan.closed_loop = rate_hz == 0, plan.rate_hz = plan.end_rate_hz = rate_hz;
  plan.warm_up_s = kWarmUpS;
  plan.duration_s = arguments.quick ? std::min(1.0, arguments.duration_s) : arguments.duration_s;
  LoadFigures figures = measure_load(plan, 1);
  for (const auto* ended : {&figures.tally.refused, &figures.tally.failed})
    if (!ended->empty()) throw BenchError("touch streams were not served: " + of_statuses(*ended));
  return figures;
}

Curve shares_of(const char* title, const LoadFigures& loop) {
  Curve curve{.title = title, .style = "lines lw 2"};
  for (const auto& [seconds, at_most] : loop.tally.latency.shares()) curve.add(1e3 * seconds, at_most);
  return curve;
}

void draw(const Figures& figures, const std::filesystem::path& folder) {
  plot(folder / "throughput.png",
       script_of({shares_of("closed loop", figures.closed_loop), shares_of("open loop", figures.open_loop)},
                 "set logscale x\nset key bottom right\n" +
                     axes("touches of a running service", "latency (ms)", "share of the answers")));
}

ServiceFigures describe_service(const std::shared_ptr<grpc::Channel>& channel) {
  const v1::GetInfoResponse info = client::get_info(channel);
  return {info.build(), info.api_version(), info.device().name(), info.device().driver_version(),
          grpc::Version()};
}

Figures measure(const Arguments& arguments, Promises& promises) {
  const auto channel = connect(arguments.service);
  Figures figures{describe_service(channel), arguments.clients, {}, {}, {}};
  const bool own = arguments.scene_id.empty();
  if (own)
    figures.checked = make_checked_scene(channel, kOwnScene, own_tissue(), LoadOptions{}.indentation_m);
  const LoadOptions load = load_over(channel, own ? kOwnScene : arguments.scene_id);
  if (!own) figures.checked = {"slope of the energy", check_energy_slope(channel, load.scene_id, load)};
  std::printf("answers checked against the %s: off by at most %.2g\n", figures.checked.against.c_str(),
              figures.checked.largest_relative_error);
  figures.closed_loop = run_clients(arguments, load, 0);
  figures.open_loop = run_clients(arguments, load, arguments.open_loop_hz);
  promises = {{"closed_loop_answers", figures.closed_loop.answers_per_s, kTouchesPerS, "1/s", false},
              {"closed_loop_latency_p99", figures.closed_loop.p99_s, kLatencyS, "s"},
              {"open_loop_latency_p99", figures.open_loop.p99_s, kLatencyS, "s"}};
  return figures;
}

}  // namespace

void add_throughput_suite(CLI::App& app, bool& met) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command = add_suite(app, "throughput", "touches/s and latency of a running service", arguments,
                                met, measure, draw);
  add_service_options(command, arguments->service);
  command.add_option("--scene", arguments->scene_id, "a scene to touch; without it the suite makes its own");
  command.add_option("--clients", arguments->clients, "touch streams at once")->check(CLI::Range(1, 256));
  command.add_option("--duration-s", arguments->duration_s, "of each loop")->check(CLI::PositiveNumber);
  command
      .add_option("--open-loop-hz", arguments->open_loop_hz, "poses per second and client in the open loop")
      ->check(CLI::PositiveNumber);
}

}  // namespace teletact::bench
