// teletact-bench soak: a running service under everything at once, for an hour.
//
// Sixty streams touch, first alone, then beside four clients that publish windows (three of them each window
// within a time, one as many long calls as it can), one that never reads and one whose connection is reset
// every second. Promised: touch hardly notices, memory does not grow, a window comes in time or is refused at
// once.
#include "bench/suites/soak.h"

#include <fmt/format.h>
#include <grpcpp/grpcpp.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>

#include "bench/own_scene.h"
#include "bench/suite.h"
#include "bench/touch_client.h"
#include "client/acquire/estimate_client.h"
#include "client/acquire/simulated_source.h"
#include "client/link/channel.h"

namespace teletact::bench {
namespace {

using nlohmann::json;
using Clock = std::chrono::steady_clock;

constexpr double kMostP99Growth = 0.20, kMostMemoryGrowthBytes = 1e6;
constexpr double kMemoryFrom = 0.25;  // of the time: what comes first is warming up
constexpr const char* kTouchedScene = "soak-touched";

struct Arguments {
  SuiteOptions suite;
  soak::Service service;
  pid_t pid = 0;
  double duration_s = 3600, alone_s = 300, every_s = 2, finish_within_s = 5, touch_rate_hz = 20;
  unsigned touch_streams = 60, fair = 3;
};

// 120 mm with one inclusion, RF of windows of 30 mm.
std::vector<client::FramePair> simulated_pairs(const client::Tissue& tissue) {
  const client::Patient patient(tissue);
  client::SimulatedSource source(patient, 1, 0, {});
  std::vector<client::FramePair> pairs;
  for (std::size_t k = 0; k < source.window_count(); ++k) pairs.push_back(source.take(k));
  return pairs;
}

client::Tissue soaked_tissue() {
  client::Tissue tissue;
  tissue.width_m = 0.12;
  tissue.probe.width_m = 0.03;
  tissue.probe.lines = 128;
  tissue.inclusions.push_back({0.05, 0.012, 0.012, 4});
  return tissue;
}

void remove_scene(v1::Palpation::Stub& stub, const std::string& id) {
  grpc::ClientContext context;
  v1::DeleteSceneRequest request;
  request.set_scene_id(id);
  v1::DeleteSceneResponse response;
  stub.DeleteScene(&context, request, &response);
}

// An empty one to publish into; one of an earlier run gives way.
void create_scene(v1::Palpation::Stub& stub, const std::string& id, const client::Tissue& tissue) {
  remove_scene(stub, id);
  grpc::ClientContext context;
  v1::CreateSceneRequest request;
  request.set_scene_id(id);
  request.mutable_geometry()->add_size_m(tissue.width_m);
  request.mutable_geometry()->add_size_m(tissue.depth_m);
  request.mutable_geometry()->set_poisson_ratio(tissue.poisson_ratio);
  v1::Scene scene;
  const grpc::Status status = stub.CreateScene(&context, request, &scene);
  if (!status.ok()) throw BenchError("CreateScene: " + client::describe(status));
}

// --- touch -------------------------------------------------------------------------------------------------

struct Touched {
  json figures;
  std::uint64_t ended = 0;  // streams that the service ended or refused
};

Touched touch(const Arguments& arguments, double duration_s) {
  LoadOptions load;
  load.scene_id = kTouchedScene;
  load.begin_m = 0.008, load.end_m = 0.112;
  load.duration_s = duration_s;
  load.rate_hz = arguments.touch_rate_hz;
  std::mutex mutex;
  std::vector<double> latency_s;
  std::uint64_t without_force = 0, ended = 0;
  std::map<std::string, std::uint64_t> ends;
  std::vector<std::thread> threads;
  for (unsigned k = 0; k < arguments.touch_streams; ++k)
    threads.emplace_back([&, k] {
      try {
        const auto channel = client::make_channel(arguments.service.address, arguments.service.tls_ca);
        const LoadResult result = run_load(channel, load, k);
        const std::lock_guard lock(mutex);
        without_force += result.without_force;
        latency_s.insert(latency_s.end(), result.latency_s.begin(), result.latency_s.end());
      } catch (const BenchError& error) {
        const std::lock_guard lock(mutex);
        ++ended;
        ++ends[error.what()];
      }
    });
  for (std::thread& thread : threads) thread.join();
  return {{{"streams", arguments.touch_streams},
           {"rate_hz", arguments.touch_rate_hz},
           {"seconds", duration_s},
           {"without_force", without_force},
           {"ended", ended},
           {"ends", ends},
           {"latency_s", quantiles(latency_s)}},
          ended};
}

// --- memory ------------------------------------------------------------------------------------------------

double resident_bytes(pid_t pid) {
  std::ifstream file(fmt::format("/proc/{}/statm", pid));
  double pages = 0, resident = 0;
  if (!(file >> pages >> resident))
    throw BenchError(fmt::format("--pid {}: no such process; give that of teletact-service", pid));
  return resident * static_cast<double>(sysconf(_SC_PAGESIZE));
}

double reported_bytes(const std::shared_ptr<grpc::Channel>& channel) {
  double bytes = 0;
  const v1::GetInfoResponse info = client::get_info(channel);
  for (const v1::MemoryUse& use : info.memory())
    bytes += use.place() == "host" ? static_cast<double>(use.bytes()) : 0;
  return bytes;
}

// What the service holds, now and then until it goes out of scope.
class MemoryLog {
 public:
  MemoryLog(const Arguments& arguments, std::shared_ptr<grpc::Channel> channel)
      : thread_(
            [this, pid = arguments.pid, every_s = arguments.duration_s / 720, channel = std::move(channel)] {
              const auto begin = Clock::now();
              while (!stop_) {
                const std::chrono::duration<double> at = Clock::now() - begin;
                samples_.push_back({at.count(), pid != 0 ? resident_bytes(pid) : reported_bytes(channel)});
                for (double waited_s = 0; !stop_ && waited_s < every_s; waited_s += 0.05)
                  std::this_thread::sleep_for(std::chrono::milliseconds(50));
              }
            }) {}
  ~MemoryLog() { stop(); }
  const std::vector<std::array<double, 2>>& stop() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
    return samples_;
  }

 private:
  std::vector<std::array<double, 2>> samples_;  // s, bytes
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

// Of the straight line through the samples after kMemoryFrom of the time, from its begin to its end.
double memory_growth_bytes(const std::vector<std::array<double, 2>>& samples) {
  double n = 0, t = 0, b = 0, tt = 0, tb = 0;
  const double from_s = kMemoryFrom * samples.back()[0];
  for (const auto& [at_s, bytes] : samples) {
    if (at_s < from_s) continue;
    n += 1, t += at_s, b += bytes, tt += at_s * at_s, tb += at_s * bytes;
  }
  const double slope = (n * tb - t * b) / (n * tt - t * t);
  return slope * (samples.back()[0] - from_s);
}

// --- the whole ---------------------------------------------------------------------------------------------

json windows_of(const soak::FairImager& imager) {
  const auto& w = imager.windows();
  json out{{"name", imager.name()},
           {"published", w.published_s.size()},
           {"refused", w.refused_s.size()},
           {"late", w.late_s.size()},
           {"late_s", w.late_s},
           {"ends", imager.statuses().counts()}};
  if (!w.published_s.empty()) out["published_s"] = quantiles(w.published_s);
  if (!w.refused_s.empty()) out["refused_s"] = quantiles(w.refused_s);
  return out;
}

json everything(const Arguments& arguments, const std::vector<client::FramePair>& pairs,
                const std::shared_ptr<grpc::Channel>& channel) {
  MemoryLog memory(arguments, channel);
  std::vector<std::unique_ptr<soak::FairImager>> fair;
  for (unsigned k = 0; k < arguments.fair; ++k)
    fair.push_back(std::make_unique<soak::FairImager>(arguments.service, fmt::format("soak-fair-{}", k),
                                                      fmt::format("soak-fair-{}", k), pairs,
                                                      arguments.every_s, arguments.finish_within_s));
  json out;
  {
    const soak::Greedy greedy(arguments.service, "soak-greedy", pairs);
    const soak::NeverReading never_reading(arguments.service, kTouchedScene, pairs.front());
    const soak::Dying dying(arguments.service, kTouchedScene, pairs.front());
    out["touch"] = touch(arguments, arguments.duration_s).figures;
    for (const auto& imager : fair) imager->stop();
    const auto samples = memory.stop();
    out["memory"] = {{"of", arguments.pid != 0 ? "resident" : "reported"},
                     {"growth_bytes", memory_growth_bytes(samples)},
                     {"samples", samples}};
    out["rogues"] = {{"greedy", greedy.statuses().counts()},
                     {"never_reading", never_reading.statuses().counts()},
                     {"dying", dying.statuses().counts()}};
  }
  for (const auto& imager : fair) out["fair"].push_back(windows_of(*imager));
  return out;
}

void print(const json& result) {
  for (const char* phase : {"alone", "together"}) {
    const json& l =
        (phase == std::string("alone") ? result["alone"] : result["together"]["touch"])["latency_s"];
    std::printf("touch %-9s p50 %.3f ms  p99 %.3f ms  max %.1f ms  of %zu answers\n", phase,
                1e3 * l["p50"].get<double>(), 1e3 * l["p99"].get<double>(), 1e3 * l["max"].get<double>(),
                l["count"].get<std::size_t>());
  }
  for (const json& client : result["together"]["fair"])
    std::printf("%s: %zu windows in time, %zu refused at once, %zu late; ends: %s\n",
                client["name"].get<std::string>().c_str(), client["published"].get<std::size_t>(),
                client["refused"].get<std::size_t>(), client["late"].get<std::size_t>(),
                client["ends"].dump().c_str());
  for (const auto& [name, ends] : result["together"]["rogues"].items())
    std::printf("%s: %s\n", name.c_str(), ends.dump().c_str());
}

void draw(const json& result, const std::string& folder) {
  std::string script = "$memory << EOD\n";
  for (const auto& sample : result.at("together").at("memory").at("samples"))
    script +=
        fmt::format("{:.2f} {:.3f}\n", sample.at(0).get<double>() / 60, sample.at(1).get<double>() * 1e-6);
  plot(std::filesystem::path(folder) / "soak.png",
       script +
           "EOD\nset xlabel 'time (min)'\nset ylabel 'memory of the service (MB)'\nset yrange [0:]\n"
           "plot $memory with lines lw 2 notitle\n");
}

bool run(Arguments arguments) {
  if (replotted(arguments.suite, "soak", draw)) return true;
  if (arguments.service.address.empty()) throw BenchError("give --service: the address of a running service");
  if (arguments.suite.quick) arguments.alone_s = 15, arguments.duration_s = 45;
  const auto channel =
      client::reach_service(arguments.service.address, arguments.service.tls_ca,
                            [](const std::string& line) { std::fprintf(stderr, "%s\n", line.c_str()); });
  if (arguments.pid == 0 && client::get_info(channel).memory().empty())
    throw BenchError("the service does not report its memory: give --pid");
  if (arguments.pid != 0) resident_bytes(arguments.pid);
  const auto stub = v1::Palpation::NewStub(channel);
  const client::Tissue tissue = soaked_tissue();
  const std::vector<client::FramePair> pairs = simulated_pairs(tissue);
  std::vector<std::string> scenes{"soak-greedy"};
  for (unsigned k = 0; k < arguments.fair; ++k) scenes.push_back(fmt::format("soak-fair-{}", k));
  for (const std::string& id : scenes) create_scene(*stub, id, tissue);
  create_own_scene(*stub, kTouchedScene, own_tissue());
  json result{{"suite", "soak"},
              {"finish_within_s", arguments.finish_within_s},
              {"window_every_s", arguments.every_s},
              {"alone", touch(arguments, arguments.alone_s).figures}};
  result["together"] = everything(arguments, pairs, channel);
  scenes.push_back(kTouchedScene);
  for (const std::string& id : scenes) remove_scene(*stub, id);
  print(result);
  const json& together = result["together"];
  const auto p99 = [](const json& touched) { return touched["latency_s"]["p99"].get<double>(); };
  double late = 0, published = 0;
  for (const json& client : together["fair"])
    late += client["late"].get<double>(), published += client["published"].get<double>();
  const bool met =
      finish(result,
             {{"growth of touch p99", p99(together["touch"]) / p99(result["alone"]) - 1, kMostP99Growth, "1"},
              {"touch streams ended", together["touch"]["ended"], 0, "1"},
              {"windows neither in time nor refused at once", late, 0, "1"},
              {"windows published", published, 1, "1", false},
              {fmt::format("growth of memory over the last {:.0f} min",
                           (1 - kMemoryFrom) * arguments.duration_s / 60),
               together["memory"]["growth_bytes"], kMostMemoryGrowthBytes, "B"}},
             arguments.suite);
  if (!arguments.suite.out.empty()) draw(result, arguments.suite.out);
  return met;
}

}  // namespace

void add_soak_suite(CLI::App& app, bool& met) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command =
      *app.add_subcommand("soak", "an hour of touch and imaging beside clients that misbehave");
  command.add_option("--service", arguments->service.address, "HOST:PORT or unix:/path")
      ->check(client::address_problem);
  command.add_option_function<std::string>(
      "--tls-ca",
      [arguments](const std::string& path) { arguments->service.tls_ca = client::read_tls_ca(path); },
      "PEM certificate that signed the service's");
  command.add_option("--pid", arguments->pid,
                     "process of the service, on this machine: its resident memory is looked at instead of "
                     "what it reports");
  command.add_option("--duration-s", arguments->duration_s, "with everything at once")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command.add_option("--alone-s", arguments->alone_s, "touching alone, before")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command.add_option("--touch-streams", arguments->touch_streams, "streams that touch")
      ->check(CLI::Range(1, 62))
      ->capture_default_str();
  command.add_option("--touch-rate-hz", arguments->touch_rate_hz, "poses per second and stream")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command.add_option("--window-every-s", arguments->every_s, "windows of each client with a deadline")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command.add_option("--finish-within-s", arguments->finish_within_s, "the deadline, after the last RF byte")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  add_common_options(command, arguments->suite);
  command.callback([arguments, &met] { met = run(*arguments); });
}

}  // namespace teletact::bench
