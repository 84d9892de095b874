// teletact-bench soak: a running service under everything at once, for an hour.
//
// Sixty streams touch beside four clients that publish windows (three of them each window within a time, one
// as many long calls as it can), one that never reads and one whose connection is reset every second. In each
// minute those that image pause for a while, and for a while of that every core has other work: what touch
// feels of imaging is told from the same streams, half a minute apart, and not from another hour of the
// machine. Promised: touch hardly notices, what the service holds does not grow, a window comes in time or is
// refused at once.
#include "bench/suites/soak/soak.h"

#include <fmt/format.h>
#include <grpcpp/grpcpp.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>

#include "bench/basics/clock.h"
#include "bench/curves.h"
#include "bench/load/trend.h"
#include "bench/own_scene.h"
#include "bench/process_metrics.h"
#include "bench/run_suite.h"
#include "bench/suites/soak/rounds.h"
#include "bench/touch_client.h"
#include "client/acquire/estimate_client.h"
#include "client/link/channel.h"

namespace teletact::bench {
namespace {

constexpr double kAnswered = 0.99, kPublished = 0.5;  // of the poses; of the windows
constexpr double kMaxP99Growth = 0.20, kMaxBytesPerHour = 1e6, kMaxPerHour = 1;
constexpr double kWarmUp = 0.25;  // of the time
constexpr const char* kTouchedScene = "soak-touched";
constexpr double kSettleS = 6;  // after imaging has paused: longer than a window may take
constexpr double kSliceS = 5;   // answers judged together; the first of each part is left out

struct Arguments : SuiteOptions {
  Service service;
  std::string admin{};
  double duration_s = 3600, every_s = 2, finish_within_s = 5, touch_rate_hz = 20;
  unsigned touch_streams = 60, fair = 3;
};

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

// p99_s: the median over the slices of one part of the p99 within each. One bad moment of the machine is one
// slice.
struct PartFigures {
  Quantiles latency_s;
  std::vector<double> p99_s_by_slice{};
  double p99_s = 0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(PartFigures, latency_s, p99_s_by_slice, p99_s)
struct TouchFigures {
  unsigned streams = 0;
  double rate_hz = 0;
  std::uint64_t poses = 0, poses_answered = 0, answers = 0, without_force = 0;
  std::uint64_t ended = 0;  // streams that the service ended or refused
  Ends ends{};
  PartFigures imaging{}, idle{}, busy_cores{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(TouchFigures, streams, rate_hz, poses, poses_answered, answers,
                                   without_force, ended, ends, imaging, idle, busy_cores)

PartFigures by_slices(const std::vector<Slice>& slices, soak::Part part) {
  PartFigures out;
  std::vector<double> all_s;
  for (const Slice& slice : slices) {
    if (slice.part != part || !slice.settled || slice.latency_s.empty()) continue;
    out.p99_s_by_slice.push_back(quantiles(slice.latency_s).p99);
    all_s.insert(all_s.end(), slice.latency_s.begin(), slice.latency_s.end());
  }
  if (all_s.empty()) throw BenchError("no answer in a part of a round: give a longer --duration-s");
  out.latency_s = quantiles(std::move(all_s));
  out.p99_s = quantiles(out.p99_s_by_slice).p50;
  return out;
}

TouchFigures touch(const Arguments& arguments) {
  LoadOptions load;
  load.scene_id = kTouchedScene;
  load.begin_m = 0.008, load.end_m = 0.112;
  load.duration_s = arguments.duration_s;
  load.rate_hz = arguments.touch_rate_hz;
  std::mutex mutex;
  std::vector<Slice> slices = empty_slices(arguments.duration_s);
  TouchFigures out{arguments.touch_streams, arguments.touch_rate_hz};
  std::vector<std::thread> threads;
  for (unsigned k = 0; k < arguments.touch_streams; ++k)
    threads.emplace_back([&, k] {
      try {
        // Spread over a period: sixty hands do not move in step.
        const double wait_s = k / (load.rate_hz * arguments.touch_streams);
        std::this_thread::sleep_for(std::chrono::duration<double>(wait_s));
        const auto channel = client::make_channel(arguments.service.address, arguments.service.credentials);
        const LoadResult result = run_load(channel, load, k);
        const std::lock_guard lock(mutex);
        out.without_force += result.without_force;
        out.answers += result.answers;
        out.poses += result.poses, out.poses_answered += result.latency_s.size();
        for (std::size_t i = 0; i < result.latency_s.size(); ++i)
          if (const auto at = static_cast<std::size_t>(result.answered_s[i] / kSliceS); at < slices.size())
            slices[at].latency_s.push_back(result.latency_s[i]);
      } catch (const BenchError& error) {
        const std::lock_guard lock(mutex);
        ++out.ends[error.what()], ++out.ended;
      }
    });
  for (std::thread& thread : threads) thread.join();
  out.imaging = by_slices(slices, soak::Part::kImaging);
  out.idle = by_slices(slices, soak::Part::kIdle);
  out.busy_cores = by_slices(slices, soak::Part::kBusyCores);
  return out;
}

// --- what it holds ----------------------------------------------------------------------------------------

double reported_bytes(const std::shared_ptr<grpc::Channel>& channel) {
  double bytes = 0;
  const v1::GetInfoResponse info = client::get_info(channel);
  for (const v1::MemoryUse& use : info.memory())
    bytes += use.place() == "host" ? static_cast<double>(use.bytes()) : 0;
  return bytes;
}

// Of one thing the service holds, from kWarmUp of the time on: what comes first is warming up.
struct HeldFigures {
  double per_hour = 0, per_hour_upper_95 = 0, least = 0, most = 0;
  std::vector<std::array<double, 2>> samples{};  // s, bytes or how many; from the begin on
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(HeldFigures, per_hour, per_hour_upper_95, least, most, samples)

HeldFigures held(std::vector<std::array<double, 2>> samples) {
  if (samples.empty()) throw BenchError("no sample of what the service holds: give a longer --duration-s");
  std::vector<std::array<double, 2>> warm = samples;
  std::erase_if(warm, [from_s = kWarmUp * samples.back()[0]](const auto& s) { return s[0] < from_s; });
  const Trend trend = trend_of(warm);
  const auto [least, most] =
      std::ranges::minmax(warm, {}, [](const std::array<double, 2>& s) { return s[1]; });
  return {trend.per_hour, trend.upper_95, least[1], most[1], std::move(samples)};
}

// Nothing is imaged, no core has other work, and what there was for the moment alone is given up.
bool between_windows(double time_s) {
  return soak::part_at(time_s) == soak::Part::kIdle && soak::part_at(time_s - kSettleS) == soak::Part::kIdle;
}

// What the service holds, now and then until it is stopped or goes out of scope: memory in use between
// windows, the rest at all times. A sample that cannot be taken ends the log; stop() tells.
class HeldLog {
 public:
  HeldLog(const Arguments& arguments, std::shared_ptr<grpc::Channel> channel)
      : thread_([this, admin = arguments.admin, every_s = arguments.duration_s / 720,
                 channel = std::move(channel)] {
          try {
            log(admin, every_s, channel);
          } catch (const std::exception& e) {
            error_ = e.what();
          }
        }) {}
  ~HeldLog() { join(); }
  struct Samples {
    std::vector<std::array<double, 2>> in_use, resident, descriptors, threads;
  };
  // Throws BenchError for a log that ended early.
  const Samples& stop() {
    join();
    if (!error_.empty()) throw BenchError(error_);
    return samples_;
  }

 private:
  void log(const std::string& admin, double every_s, const std::shared_ptr<grpc::Channel>& channel) {
    const auto begin = Clock::now();
    while (!stop_) {
      const double at_s = seconds_since(begin);
      if (admin.empty()) {
        if (between_windows(at_s)) samples_.in_use.push_back({at_s, reported_bytes(channel)});
      } else {
        const std::map<std::string, double> now = process_metrics(admin);
        if (between_windows(at_s)) samples_.in_use.push_back({at_s, now.at("process_heap_bytes")});
        samples_.resident.push_back({at_s, now.at("process_resident_memory_bytes")});
        samples_.descriptors.push_back({at_s, now.at("process_open_fds")});
        samples_.threads.push_back({at_s, now.at("process_threads")});
      }
      while (!stop_ && seconds_since(begin) < at_s + every_s)
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
  }
  void join() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
  }
  Samples samples_;
  std::string error_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

// --- the whole ---------------------------------------------------------------------------------------------

struct Figures {
  double duration_s = 0, finish_within_s = 0, window_every_s = 0;
  TouchFigures touch{};
  HeldFigures memory{};    // bytes in use; without --admin what the service reports
  HeldFigures resident{};  // bytes; this and the rest with --admin alone
  HeldFigures descriptors{}, threads{};
  std::map<std::string, Ends> rogues{};
  std::vector<WindowFigures> fair{};
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(Figures, duration_s, finish_within_s, window_every_s, touch, memory,
                                   resident, descriptors, threads, rogues, fair)

Figures everything(const Arguments& arguments, const std::vector<client::FramePair>& pairs,
                   const std::shared_ptr<grpc::Channel>& channel) {
  Figures out{arguments.duration_s, arguments.finish_within_s, arguments.every_s};
  HeldLog log(arguments, channel);
  Pause pause = false;
  std::vector<std::unique_ptr<Imager>> fair;
  for (unsigned k = 0; k < arguments.fair; ++k)
    fair.push_back(std::make_unique<Imager>(arguments.service, fmt::format("soak-fair-{}", k),
                                            fmt::format("soak-fair-{}", k), pairs, arguments.every_s,
                                            arguments.finish_within_s, pause));
  {
    const auto greedy = soak::start_greedy(arguments.service, "soak-greedy", pairs, pause);
    const auto never_reading = soak::start_never_reading(arguments.service, kTouchedScene, pairs.front());
    const auto dying = soak::start_dying(arguments.service, kTouchedScene, pairs.front());
    const soak::Rounds rounds(pause);
    out.touch = touch(arguments);
    for (const auto& imager : fair) imager->stop();
    const HeldLog::Samples& samples = log.stop();
    out.memory = held(samples.in_use);
    if (!arguments.admin.empty())
      out.resident = held(samples.resident), out.descriptors = held(samples.descriptors),
      out.threads = held(samples.threads);
    out.rogues = {{"greedy", greedy->statuses.counts()},
                  {"never_reading", never_reading->statuses.counts()},
                  {"dying", dying->statuses.counts()}};
  }
  for (const auto& imager : fair) out.fair.push_back(imager->windows());
  return out;
}

void print(const Figures& figures) {
  const auto part = [](const char* name, const PartFigures& p) {
    std::printf("touch, %-10s p99 of a slice of %g s, median %.3f ms; all: p50 %.3f  p99 %.3f  max %.1f ms\n",
                name, kSliceS, 1e3 * p.p99_s, 1e3 * p.latency_s.p50, 1e3 * p.latency_s.p99,
                1e3 * p.latency_s.max);
  };
  part("imaging", figures.touch.imaging), part("idle", figures.touch.idle);
  part("busy cores", figures.touch.busy_cores);
  for (const WindowFigures& w : figures.fair) std::printf("%s\n", line_of(w).c_str());
  for (const auto& [name, ends] : figures.rogues) std::printf("%s:%s\n", name.c_str(), text_of(ends).c_str());
}

void draw(const Figures& figures, const std::filesystem::path& folder) {
  std::vector<Curve> curves;
  for (const auto& [title, held] : {std::pair{"in use", &figures.memory}, {"resident", &figures.resident}}) {
    if (held->samples.empty()) continue;
    curves.push_back({.title = title, .style = "lines lw 2"});
    for (const auto& [time_s, bytes] : held->samples) curves.back().add(time_s / 60, bytes * 1e-6);
  }
  plot(folder / "soak.png", script_of(curves, "set yrange [0:]\n" + axes("everything at once", "time (min)",
                                                                         "memory of the service (MB)")));
}

void promise(const Figures& figures, Promises& promises) {
  const TouchFigures& touched = figures.touch;
  double late = 0, published = 0, all = 0;
  for (const WindowFigures& w : figures.fair) {
    late += double(w.late), published += double(w.published);
    all += double(w.published + w.refused + w.late);
  }
  promises = {
      {"touch_p99_growth_by_imaging", touched.imaging.p99_s / touched.idle.p99_s - 1, kMaxP99Growth},
      {"touch_p99_growth_by_imaging_beside_busy_cores", touched.imaging.p99_s / touched.busy_cores.p99_s - 1,
       kMaxP99Growth},
      {"touch_streams_ended", double(touched.ended), 0},
      {"poses_answered", double(touched.poses_answered) / double(touched.poses), kAnswered, "", false},
      {"touches_without_force", double(touched.without_force), 0},
      {"windows_neither_in_time_nor_refused_at_once", late, 0},
      {"windows_published", published / all, kPublished, "", false},
      {"memory_growth_an_hour_95_percent_bound", figures.memory.per_hour_upper_95, kMaxBytesPerHour, "B"}};
  if (figures.descriptors.samples.empty()) return;
  promises.push_back({"resident_memory_growth_an_hour_95_percent_bound", figures.resident.per_hour_upper_95,
                      kMaxBytesPerHour, "B"});
  promises.push_back(
      {"descriptors_more_an_hour_95_percent_bound", figures.descriptors.per_hour_upper_95, kMaxPerHour});
  promises.push_back(
      {"threads_more_an_hour_95_percent_bound", figures.threads.per_hour_upper_95, kMaxPerHour});
}

Figures measure(Arguments arguments, Promises& promises) {
  if (arguments.quick) arguments.duration_s = soak::kRoundS;
  const auto channel = connect(arguments.service);
  if (arguments.admin.empty() && client::get_info(channel).memory().empty())
    throw BenchError("the service does not report its memory: give --admin");
  if (!arguments.admin.empty() && !process_metrics(arguments.admin).contains("process_heap_bytes"))
    throw BenchError(
        fmt::format("--admin {}: no process_heap_bytes; its service is an older one", arguments.admin));
  const auto stub = v1::Palpation::NewStub(channel);
  const client::Tissue tissue = imaged_tissue();
  const std::vector<client::FramePair> pairs = imaged_pairs(tissue);
  std::vector<std::string> scenes{"soak-greedy"};
  for (unsigned k = 0; k < arguments.fair; ++k) scenes.push_back(fmt::format("soak-fair-{}", k));
  for (const std::string& id : scenes) create_imaged_scene(*stub, id, tissue);
  create_own_scene(*stub, kTouchedScene, own_tissue());
  Figures figures = everything(arguments, pairs, channel);
  scenes.push_back(kTouchedScene);
  for (const std::string& id : scenes) remove_scene(*stub, id);
  print(figures);
  promise(figures, promises);
  return figures;
}

}  // namespace

void add_soak_suite(CLI::App& app, bool& met) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command = add_suite(app, "soak", "an hour of touch and imaging beside clients that misbehave",
                                arguments, met, measure, draw);
  add_service_options(command, arguments->service);
  command.add_option("--admin", arguments->admin,
                     "--admin address of the service: its memory in use, resident memory, descriptors and "
                     "threads are looked at "
                     "instead of what it reports");
  command
      .add_option("--duration-s", arguments->duration_s, "how long; imaging pauses for half of each minute")
      ->check(CLI::Range(soak::kRoundS, 1e6));
  command.add_option("--touch-streams", arguments->touch_streams, "streams that touch")
      ->check(CLI::Range(1, 62));
  command.add_option("--touch-rate-hz", arguments->touch_rate_hz, "poses per second and stream")
      ->check(CLI::PositiveNumber);
  command.add_option("--window-every-s", arguments->every_s, "windows of each client with a deadline")
      ->check(CLI::PositiveNumber);
  command.add_option("--finish-within-s", arguments->finish_within_s, "the deadline, after the last RF byte")
      ->check(CLI::PositiveNumber);
}

}  // namespace teletact::bench
