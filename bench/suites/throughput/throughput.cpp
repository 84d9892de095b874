// teletact-bench throughput: touches per second and latency of a running service, closed and open loop.
//
// Before timing, answers are checked: on the suite's own scene against the dense reference (T4.1) of the same
// grid and modulus; on a given scene, whose tissue is unknown here, the force against the slope of the energy
// (T4.5).
#include <fmt/format.h>
#include <grpcpp/grpcpp.h>

#include <cmath>
#include <cstdio>
#include <memory>
#include <thread>

#include "bench/own_scene.h"
#include "bench/service.h"
#include "bench/suite.h"
#include "bench/touch_client.h"
#include "client/link/channel.h"
#include "teletact/v1/info.grpc.pb.h"

namespace teletact::bench {
namespace {

using nlohmann::json;

// What a single operator is promised on two processor cores.
constexpr double kTouchesPerS = 200, kLatencyS = 0.010;
constexpr double kSlopeTolerance = 2e-2;  // central difference of the energy over 0.2 mm
constexpr double kConnectWaitS = 5;
constexpr const char* kOwnScene = "bench-throughput";

struct Arguments {
  SuiteOptions suite;
  Service service;
  std::string scene_id;
  unsigned clients = 1;
  double duration_s = 5, open_loop_hz = 500;
};

// Largest relative difference of the force from -dU/dy.
double check_energy_slope(const std::shared_ptr<grpc::Channel>& channel, const std::string& scene_id,
                          const LoadOptions& load) {
  constexpr double kStepM = 1e-4;
  double worst = 0;
  for (const double share : {0.2, 0.5, 0.8}) {
    const double x_m = load.begin_m + share * (load.end_m - load.begin_m);
    const auto at = [&](double y_m) { return touch_once(channel, scene_id, x_m, y_m); };
    const double slope =
        (at(load.indentation_m + kStepM).energy_j() - at(load.indentation_m - kStepM).energy_j()) /
        (2 * kStepM);
    const v1::TouchAnswer answer = at(load.indentation_m);
    if (answer.force_n_size() < 2) throw BenchError("an answer without force: " + answer.warning());
    const double error = std::abs(-slope - answer.force_n(1)) / std::abs(slope);
    if (!(error <= kSlopeTolerance))
      throw BenchError(fmt::format(
          "the force at x = {} m is off by {:.3g} of its energy's slope: not worth timing", x_m, error));
    worst = std::max(worst, error);
  }
  return worst;
}

// The widest range that windows cover without a gap, 8 mm inside.
LoadOptions load_over(v1::Palpation::Stub& stub, const std::string& scene_id) {
  v1::GetSceneRequest request;
  request.set_scene_id(scene_id);
  v1::Scene scene;
  grpc::ClientContext context;
  const grpc::Status status = stub.GetScene(&context, request, &scene);
  if (!status.ok()) throw BenchError("GetScene: " + client::describe(status));
  constexpr double kInsideM = 0.008;
  LoadOptions load;
  load.scene_id = scene_id;
  for (const v1::Window& window : scene.windows()) {
    if (!window.touchable() ||
        window.covers().end_x_m() - window.covers().begin_x_m() <= load.end_m - load.begin_m + 2 * kInsideM)
      continue;
    load.begin_m = window.covers().begin_x_m() + kInsideM;
    load.end_m = window.covers().end_x_m() - kInsideM;
  }
  if (!(load.end_m > load.begin_m))
    throw BenchError("--scene " + scene_id + ": nothing in it can be touched");
  return load;
}

json measure(const Arguments& arguments, LoadOptions load, double rate_hz) {
  load.rate_hz = rate_hz;
  load.duration_s = arguments.suite.quick ? std::min(1.0, arguments.duration_s) : arguments.duration_s;
  std::vector<LoadResult> results(arguments.clients);
  std::vector<std::exception_ptr> failures(arguments.clients);
  std::vector<std::thread> threads;
  for (unsigned k = 0; k < arguments.clients; ++k)
    threads.emplace_back([&, k] {
      try {
        results[k] =
            run_load(client::make_channel(arguments.service.address, arguments.service.tls_ca), load, k);
      } catch (...) {
        failures[k] = std::current_exception();
      }
    });
  for (std::thread& thread : threads) thread.join();
  for (const auto& failure : failures)
    if (failure) std::rethrow_exception(failure);
  json out{{"clients", json::array()}, {"rate_hz_per_client", rate_hz}};
  std::vector<double> all;
  double answers_per_s = 0;
  for (const LoadResult& r : results) {
    const double rate = static_cast<double>(r.answers) / r.elapsed_s;
    answers_per_s += rate;
    all.insert(all.end(), r.latency_s.begin(), r.latency_s.end());
    out["clients"].push_back({{"poses", r.poses},
                              {"answers", r.answers},
                              {"without_force", r.without_force},
                              {"answers_per_s", rate},
                              {"latency_s", quantiles(r.latency_s)}});
  }
  out["answers_per_s"] = answers_per_s;
  out["latency_s"] = quantiles(all);
  out["latencies_s"] = std::move(all);
  return out;
}

void draw(const json& result, const std::string& folder) {
  std::filesystem::create_directories(folder);
  std::string script;
  for (const char* loop : {"closed_loop", "open_loop"}) {
    std::vector<double> latency_s = result.at(loop).at("latencies_s");
    std::sort(latency_s.begin(), latency_s.end());
    script += fmt::format("${} << EOD\n", loop);
    const std::size_t step = std::max<std::size_t>(1, latency_s.size() / 2000);
    for (std::size_t k = 0; k < latency_s.size(); k += step)
      script += fmt::format("{:.5f} {:.6f}\n", latency_s[k] * 1e3,
                            (k + 0.5) / static_cast<double>(latency_s.size()));
    script += "EOD\n";
  }
  plot(std::filesystem::path(folder) / "throughput.png",
       script +
           "set logscale x\nset xlabel 'latency (ms)'\nset ylabel 'share of the answers'\nset key bottom "
           "right\n"
           "plot $closed_loop with lines lw 2 title 'closed loop', $open_loop with lines lw 2 title 'open "
           "loop'\n");
}

void print(const char* name, const json& loop) {
  const json& l = loop["latency_s"];
  std::printf("%-12s %8.0f answers/s  latency p50 %.3f ms  p95 %.3f ms  p99 %.3f ms  max %.3f ms\n", name,
              loop["answers_per_s"].get<double>(), 1e3 * l["p50"].get<double>(), 1e3 * l["p95"].get<double>(),
              1e3 * l["p99"].get<double>(), 1e3 * l["max"].get<double>());
}

json describe_service(const std::shared_ptr<grpc::Channel>& channel) {
  v1::GetInfoResponse info;
  grpc::ClientContext context;
  const grpc::Status status = v1::Info::NewStub(channel)->GetInfo(&context, {}, &info);
  if (!status.ok()) throw BenchError("GetInfo: " + client::describe(status));
  return {{"build", info.build()},
          {"api", info.api_version()},
          {"device", info.device().name()},
          {"driver_version", info.device().driver_version()},
          {"grpc", grpc::Version()}};
}

bool run(const Arguments& arguments) {
  if (replotted(arguments.suite, "throughput", draw)) return true;
  require_named(arguments.service);
  const auto channel = client::make_channel(arguments.service.address, arguments.service.tls_ca);
  if (!client::wait_connected(*channel, kConnectWaitS))
    throw BenchError(client::nobody_answers(arguments.service.address, arguments.service.tls_ca));
  const auto stub = v1::Palpation::NewStub(channel);
  json result{
      {"suite", "throughput"}, {"service", describe_service(channel)}, {"clients", arguments.clients}};
  const bool own = arguments.scene_id.empty();
  const reference::TouchedTissue tissue = own_tissue();
  if (own) create_own_scene(*stub, kOwnScene, tissue);
  const LoadOptions load = load_over(*stub, own ? kOwnScene : arguments.scene_id);
  result["checked"] =
      own ? json{{"against", "dense reference"},
                 {"largest_relative_error",
                  check_against_reference(channel, kOwnScene, tissue, load.indentation_m)}}
          : json{{"against", "slope of the energy"},
                 {"largest_relative_error", check_energy_slope(channel, load.scene_id, load)}};
  std::printf("answers checked against the %s: off by at most %.2g\n",
              result["checked"]["against"].get<std::string>().c_str(),
              result["checked"]["largest_relative_error"].get<double>());
  result["closed_loop"] = measure(arguments, load, 0);
  print("closed loop", result["closed_loop"]);
  result["open_loop"] = measure(arguments, load, arguments.open_loop_hz);
  print("open loop", result["open_loop"]);
  const bool met =
      finish(result,
             {{"closed loop answers", result["closed_loop"]["answers_per_s"], kTouchesPerS, "1/s", false},
              {"closed loop latency p99", result["closed_loop"]["latency_s"]["p99"], kLatencyS, "s"},
              {"open loop latency p99", result["open_loop"]["latency_s"]["p99"], kLatencyS, "s"}},
             arguments.suite);
  if (!arguments.suite.out.empty()) draw(result, arguments.suite.out);
  return met;
}

}  // namespace

void add_throughput_suite(CLI::App& app, bool& met) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command = *app.add_subcommand("throughput", "touches/s and latency of a running service");
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
  add_common_options(command, arguments->suite);
  command.callback([arguments, &met] { met = run(*arguments); });
}

}  // namespace teletact::bench
