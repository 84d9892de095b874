// teletact-bench soak: a running service under everything at once, for an hour.
//
// Sixty streams touch beside four clients that publish windows (three of them each window within a time, one
// as many long calls as it can), one that never reads and one whose connection is reset every second. In each
// minute those that image pause for a while, and for a while of that every core has other work: what touch
// feels of imaging is told from the same streams, half a minute apart, and not from another hour of the
// machine. Promised: touch hardly notices, memory does not grow, a window comes in time or is refused at
// once.
#include "bench/suites/soak/soak.h"

#include <fmt/format.h>
#include <grpcpp/grpcpp.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>

#include "bench/own_scene.h"
#include "bench/suite.h"
#include "bench/suites/soak/rounds.h"
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
constexpr double kSliceS = 5;  // answers judged together; the first of each part is left out

struct Arguments {
  SuiteOptions suite;
  Service service;
  pid_t pid = 0;
  double duration_s = 3600, every_s = 2, finish_within_s = 5, touch_rate_hz = 20;
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

// Latencies of the answers that came in one slice of time.
struct Slice {
  std::vector<double> latency_s;
  soak::Part part{};
  bool settled = false;
};

std::vector<Slice> empty_slices(double duration_s) {
  std::vector<Slice> slices(static_cast<std::size_t>(duration_s / kSliceS));
  for (std::size_t k = 0; k < slices.size(); ++k) {
    const double begin_s = static_cast<double>(k) * kSliceS;
    slices[k].part = soak::part_at(begin_s);
    slices[k].settled = k > 0 && slices[k].part == soak::part_at(begin_s - kSliceS);
  }
  return slices;
}

// Median over the slices of one part: of the p99 within each. One bad moment of the machine is one slice.
json by_slices(const std::vector<Slice>& slices, soak::Part part) {
  std::vector<double> p99_s, all_s;
  for (const Slice& slice : slices) {
    if (slice.part != part || !slice.settled || slice.latency_s.empty()) continue;
    p99_s.push_back(quantiles(slice.latency_s)["p99"]);
    all_s.insert(all_s.end(), slice.latency_s.begin(), slice.latency_s.end());
  }
  if (p99_s.empty()) throw BenchError("no answer in a part of a round: give a longer --duration-s");
  return {{"latency_s", quantiles(all_s)}, {"p99_s_by_slice", p99_s}, {"p99_s", quantiles(p99_s)["p50"]}};
}

json touch(const Arguments& arguments) {
  LoadOptions load;
  load.scene_id = kTouchedScene;
  load.begin_m = 0.008, load.end_m = 0.112;
  load.duration_s = arguments.duration_s;
  load.rate_hz = arguments.touch_rate_hz;
  std::mutex mutex;
  std::vector<Slice> slices = empty_slices(arguments.duration_s);
  std::uint64_t without_force = 0, answers = 0;
  std::map<std::string, std::uint64_t> ends;
  std::vector<std::thread> threads;
  for (unsigned k = 0; k < arguments.touch_streams; ++k)
    threads.emplace_back([&, k] {
      try {
        // Spread over a period: sixty hands do not move in step.
        const double wait_s = k / (load.rate_hz * arguments.touch_streams);
        std::this_thread::sleep_for(std::chrono::duration<double>(wait_s));
        const auto channel = client::make_channel(arguments.service.address, arguments.service.tls_ca);
        const LoadResult result = run_load(channel, load, k);
        const std::lock_guard lock(mutex);
        without_force += result.without_force;
        answers += result.answers;
        for (std::size_t i = 0; i < result.latency_s.size(); ++i)
          if (const auto at = static_cast<std::size_t>(result.answered_s[i] / kSliceS); at < slices.size())
            slices[at].latency_s.push_back(result.latency_s[i]);
      } catch (const BenchError& error) {
        const std::lock_guard lock(mutex);
        ++ends[error.what()];
      }
    });
  for (std::thread& thread : threads) thread.join();
  std::uint64_t ended = 0;  // streams that the service ended or refused
  for (const auto& [what, count] : ends) ended += count;
  json out{{"streams", arguments.touch_streams},
           {"rate_hz", arguments.touch_rate_hz},
           {"answers", answers},
           {"without_force", without_force},
           {"ended", ended},
           {"ends", ends}};
  for (const soak::Part part : soak::kParts) out[soak::name_of(part)] = by_slices(slices, part);
  return out;
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
  soak::Pause pause = false;
  std::vector<std::unique_ptr<soak::FairImager>> fair;
  for (unsigned k = 0; k < arguments.fair; ++k)
    fair.push_back(std::make_unique<soak::FairImager>(arguments.service, fmt::format("soak-fair-{}", k),
                                                      fmt::format("soak-fair-{}", k), pairs,
                                                      arguments.every_s, arguments.finish_within_s, pause));
  json out;
  {
    const soak::Greedy greedy(arguments.service, "soak-greedy", pairs, pause);
    const soak::NeverReading never_reading(arguments.service, kTouchedScene, pairs.front());
    const soak::Dying dying(arguments.service, kTouchedScene, pairs.front());
    const soak::Rounds rounds(pause);
    out["touch"] = touch(arguments);
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
  for (const soak::Part part : soak::kParts) {
    const json& touched = result["touch"][soak::name_of(part)];
    const json& l = touched["latency_s"];
    std::printf("touch, %-10s p99 of a slice of %g s, median %.3f ms; all: p50 %.3f  p99 %.3f  max %.1f ms\n",
                soak::name_of(part), kSliceS, 1e3 * touched["p99_s"].get<double>(),
                1e3 * l["p50"].get<double>(), 1e3 * l["p99"].get<double>(), 1e3 * l["max"].get<double>());
  }
  for (const json& client : result["fair"])
    std::printf("%s: %zu windows in time, %zu refused at once, %zu late; ends: %s\n",
                client["name"].get<std::string>().c_str(), client["published"].get<std::size_t>(),
                client["refused"].get<std::size_t>(), client["late"].get<std::size_t>(),
                client["ends"].dump().c_str());
  for (const auto& [name, ends] : result["rogues"].items())
    std::printf("%s: %s\n", name.c_str(), ends.dump().c_str());
}

void draw(const json& result, const std::string& folder) {
  std::string script = "$memory << EOD\n";
  for (const auto& sample : result.at("memory").at("samples"))
    script +=
        fmt::format("{:.2f} {:.3f}\n", sample.at(0).get<double>() / 60, sample.at(1).get<double>() * 1e-6);
  plot(std::filesystem::path(folder) / "soak.png",
       script +
           "EOD\nset xlabel 'time (min)'\nset ylabel 'memory of the service (MB)'\nset yrange [0:]\n"
           "plot $memory with lines lw 2 notitle\n");
}

bool run(Arguments arguments) {
  if (replotted(arguments.suite, "soak", draw)) return true;
  require_named(arguments.service);
  if (arguments.suite.quick) arguments.duration_s = soak::kRoundS;
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
  json result = everything(arguments, pairs, channel);
  result["suite"] = "soak";
  result["duration_s"] = arguments.duration_s;
  result["finish_within_s"] = arguments.finish_within_s;
  result["window_every_s"] = arguments.every_s;
  scenes.push_back(kTouchedScene);
  for (const std::string& id : scenes) remove_scene(*stub, id);
  print(result);
  const auto p99_s = [&](soak::Part part) {
    return result["touch"][soak::name_of(part)]["p99_s"].get<double>();
  };
  double late = 0, published = 0;
  for (const json& client : result["fair"])
    late += client["late"].get<double>(), published += client["published"].get<double>();
  const bool met =
      finish(result,
             {{"growth of touch p99 by imaging", p99_s(soak::Part::kImaging) / p99_s(soak::Part::kIdle) - 1,
               kMostP99Growth, "1"},
              {"growth of touch p99 by imaging, beside busy cores",
               p99_s(soak::Part::kImaging) / p99_s(soak::Part::kBusyCores) - 1, kMostP99Growth, "1"},
              {"touch streams ended", result["touch"]["ended"], 0, "1"},
              {"touches without force", result["touch"]["without_force"], 0, "1"},
              {"windows neither in time nor refused at once", late, 0, "1"},
              {"windows published", published, 1, "1", false},
              {fmt::format("growth of memory over the last {:.0f} min",
                           (1 - kMemoryFrom) * arguments.duration_s / 60),
               result["memory"]["growth_bytes"], kMostMemoryGrowthBytes, "B"}},
             arguments.suite);
  if (!arguments.suite.out.empty()) draw(result, arguments.suite.out);
  return met;
}

}  // namespace

void add_soak_suite(CLI::App& app, bool& met) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command =
      *app.add_subcommand("soak", "an hour of touch and imaging beside clients that misbehave");
  add_service_options(command, arguments->service);
  command.add_option("--pid", arguments->pid,
                     "process of the service, on this machine: its resident memory is looked at instead of "
                     "what it reports");
  command
      .add_option("--duration-s", arguments->duration_s, "how long; imaging pauses for half of each minute")
      ->check(CLI::Range(soak::kRoundS, 1e6))
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
