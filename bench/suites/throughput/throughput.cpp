// teletact-bench throughput: touches per second and latency of a running service, closed and open loop.
//
// Before timing, answers are checked: on the suite's own scene against the dense reference (T4.1) of the same
// grid and modulus; on a given scene, whose tissue is unknown here, the force against the slope of the energy
// (T4.5).
#include <fmt/format.h>
#include <grpcpp/grpcpp.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <future>
#include <memory>

#include "bench/curves.h"
#include "bench/own_scene.h"
#include "bench/service.h"
#include "bench/suite.h"
#include "bench/touch_client.h"
#include "client/acquire/estimate_client.h"
#include "client/link/channel.h"
#include "client/link/scenes.h"

namespace teletact::bench {
namespace {

// What a single operator is promised on two processor cores.
constexpr double kTouchesPerS = 200, kLatencyS = 0.010;
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

// The widest range that windows cover without a gap, 8 mm inside.
LoadOptions load_over(v1::Palpation::Stub& stub, const std::string& scene_id) {
  v1::Scene scene;
  const grpc::Status status = client::get_scene(stub, scene_id, v1::SCENE_VIEW_BASIC, scene);
  if (!status.ok()) throw BenchError("GetScene: " + client::describe(status));
  constexpr double kInsideM = 0.008;
  LoadOptions load;
  load.scene_id = scene_id;
  for (const client::Extent& extent : client::touchable_extents(scene)) {
    if (extent.end_x_m - extent.begin_x_m <= load.end_m - load.begin_m + 2 * kInsideM) continue;
    load.begin_m = extent.begin_x_m + kInsideM;
    load.end_m = extent.end_x_m - kInsideM;
  }
  if (!(load.end_m > load.begin_m))
    throw BenchError("--scene " + scene_id + ": nothing in it can be touched");
  return load;
}

struct ClientFigures {
  std::uint64_t poses = 0, answers = 0, without_force = 0;
  double answers_per_s = 0;
  Quantiles latency_s;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ClientFigures, poses, answers, without_force, answers_per_s, latency_s)
struct LoopFigures {
  double rate_hz_per_client = 0, answers_per_s = 0;
  std::vector<ClientFigures> clients{};
  Quantiles latency_s{};
  std::vector<double> latencies_s{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(LoopFigures, rate_hz_per_client, answers_per_s, clients, latency_s,
                                   latencies_s)
struct ServiceFigures {
  std::string build, api, device, driver_version, grpc;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ServiceFigures, build, api, device, driver_version, grpc)
struct Figures {
  ServiceFigures service;
  unsigned clients = 0;
  Checked checked;
  LoopFigures closed_loop, open_loop;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, service, clients, checked, closed_loop, open_loop)

LoopFigures run_clients(const Arguments& arguments, LoadOptions load, double rate_hz) {
  load.rate_hz = rate_hz;
  load.duration_s = arguments.quick ? std::min(1.0, arguments.duration_s) : arguments.duration_s;
  std::vector<std::future<LoadResult>> clients;
  for (unsigned k = 0; k < arguments.clients; ++k)
    clients.push_back(std::async(std::launch::async, [&, k] {
      return run_load(client::make_channel(arguments.service.address, arguments.service.tls_ca), load, k);
    }));
  LoopFigures out{rate_hz};
  for (auto& running : clients) {
    const LoadResult r = running.get();
    const double rate = static_cast<double>(r.answers) / r.elapsed_s;
    out.answers_per_s += rate;
    out.latencies_s.insert(out.latencies_s.end(), r.latency_s.begin(), r.latency_s.end());
    out.clients.push_back({r.poses, r.answers, r.without_force, rate, quantiles(r.latency_s)});
  }
  out.latency_s = quantiles(out.latencies_s);
  return out;
}

Curve shares_of(const char* title, std::vector<double> latencies_s) {
  std::sort(latencies_s.begin(), latencies_s.end());
  Curve curve{.title = title, .style = "lines lw 2"};
  const std::size_t step = std::max<std::size_t>(1, latencies_s.size() / 2000);
  for (std::size_t k = 0; k < latencies_s.size(); k += step)
    curve.add(latencies_s[k] * 1e3, (k + 0.5) / static_cast<double>(latencies_s.size()));
  return curve;
}

void draw(const Figures& figures, const std::filesystem::path& folder) {
  plot(folder / "throughput.png",
       script_of({shares_of("closed loop", figures.closed_loop.latencies_s),
                  shares_of("open loop", figures.open_loop.latencies_s)},
                 "set logscale x\nset key bottom right\n" +
                     axes("touches of a running service", "latency (ms)", "share of the answers")));
}

void print(const char* name, const LoopFigures& loop) {
  const Quantiles& l = loop.latency_s;
  std::printf("%-12s %8.0f answers/s  latency p50 %.3f ms  p95 %.3f ms  p99 %.3f ms  max %.3f ms\n", name,
              loop.answers_per_s, 1e3 * l.p50, 1e3 * l.p95, 1e3 * l.p99, 1e3 * l.max);
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
  const LoadOptions load = load_over(*v1::Palpation::NewStub(channel), own ? kOwnScene : arguments.scene_id);
  if (!own) figures.checked = {"slope of the energy", check_energy_slope(channel, load.scene_id, load)};
  std::printf("answers checked against the %s: off by at most %.2g\n", figures.checked.against.c_str(),
              figures.checked.largest_relative_error);
  figures.closed_loop = run_clients(arguments, load, 0);
  print("closed loop", figures.closed_loop);
  figures.open_loop = run_clients(arguments, load, arguments.open_loop_hz);
  print("open loop", figures.open_loop);
  promises = {{"closed_loop_answers", figures.closed_loop.answers_per_s, kTouchesPerS, "1/s", false},
              {"closed_loop_latency_p99", figures.closed_loop.latency_s.p99, kLatencyS, "s"},
              {"open_loop_latency_p99", figures.open_loop.latency_s.p99, kLatencyS, "s"}};
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
  command.add_option("--duration-s", arguments->duration_s, "of each loop")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command
      .add_option("--open-loop-hz", arguments->open_loop_hz, "poses per second and client in the open loop")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
}

}  // namespace teletact::bench
