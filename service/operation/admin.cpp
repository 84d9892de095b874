#include "service/operation/admin.h"

#include <malloc.h>
#include <prometheus/text_serializer.h>
#include <sys/resource.h>

#include <array>
#include <chrono>
#include <exception>
#include <filesystem>
#include <iterator>
#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>
#include <vector>

#include "service/rpc/status.h"

namespace teletact::service {
namespace {

using prometheus::MetricFamily;
using prometheus::MetricType;

constexpr std::array<const char*, kRefusals> kWhy{"starting",     "draining",  "full",
                                                  "client_share", "authority", "load"};

// What is read at a scrape, beside what is counted as it happens.
class Families {
 public:
  explicit Families(std::vector<MetricFamily> counted) : all_(std::move(counted)) {}
  // A gauge, or with this type a counter; values follow.
  void begin(const char* name, const char* help, MetricType type = MetricType::Gauge) {
    all_.push_back({name, help, type, {}});
  }
  void add(double value, std::vector<prometheus::ClientMetric::Label> labels = {}) {
    prometheus::ClientMetric metric;
    metric.label = std::move(labels);
    (all_.back().type == MetricType::Gauge ? metric.gauge.value : metric.counter.value) = value;
    all_.back().metric.push_back(std::move(metric));
  }
  std::string text() const { return prometheus::TextSerializer().Serialize(all_); }

 private:
  std::vector<MetricFamily> all_;
};

void add_calls(Core& core, Families& out) {
  const auto counts = core.calls.counts();
  out.begin("teletact_calls", "Calls that are served; touch: sessions");
  for (std::size_t k = 0; k < kCallKinds; ++k)
    out.add(static_cast<double>(counts[k].open), {{"kind", kKindNames[k]}});
  out.begin("teletact_calls_refused_total", "Calls that were given no place or lost it, by reason",
            MetricType::Counter);
  for (std::size_t k = 0; k < kCallKinds; ++k)
    for (std::size_t why = 0; why < kRefusals; ++why)
      out.add(static_cast<double>(counts[k].refused[why]), {{"kind", kKindNames[k]}, {"reason", kWhy[why]}});
  out.begin("teletact_calls_ended_total", "Calls that have ended, refused ones too, by status",
            MetricType::Counter);
  for (std::size_t k = 0; k < kCallKinds; ++k)
    for (const auto& [code, times] : counts[k].ended)
      out.add(static_cast<double>(times), {{"kind", kKindNames[k]}, {"code", name_of(code)}});
}

void add_memory(Core& core, Families& out) {
  out.begin("teletact_memory_bytes", "What is held, by place and kind");
  for (const MemoryUse& use : core.memory->uses())
    out.add(static_cast<double>(use.bytes), {{"place", name_of(use.place)}, {"kind", use.kind}});
  out.begin("teletact_memory_limit_bytes", "What may be held");
  out.add(static_cast<double>(core.limits.host_memory_bytes), {{"place", name_of(Place::kHost)}});
  for (std::size_t k = 0; k < core.devices.size(); ++k)
    out.add(static_cast<double>(core.limits.device_memory_bytes), {{"place", name_of(place_of_device(k))}});
}

// By their numbers, from 0.
void add_devices(Core& core, Families& out) {
  const auto add = [&](const auto& value_of) {
    for (std::size_t k = 0; k < core.imaging.lanes().size(); ++k)
      out.add(value_of(core.imaging.lanes()[k]), {{"device", std::to_string(k)}});
  };
  out.begin("teletact_imaging_busy_seconds_total",
            "That the imaging plane was at work with a device, in the mean of the pairs it may work on at once", MetricType::Counter);
  add([](const ImagingLane& lane) { return lane.busy_s(); });
  out.begin("teletact_device_works", "1: estimates are made on it; 0: it failed, or hangs");
  add([](const ImagingLane& lane) { return lane.works() ? 1.0 : 0.0; });
  out.begin("teletact_scenes_moved_total", "Scenes that another device took over", MetricType::Counter);
  out.add(static_cast<double>(core.imaging.scenes_moved()));
}

std::size_t entries_of(const char* folder) {
  std::error_code error;
  const std::filesystem::directory_iterator files(folder, error);
  return error ? 0 : static_cast<std::size_t>(std::distance(begin(files), end(files)));
}

void add_process(Families& out) {
  rusage used{};
  getrusage(RUSAGE_SELF, &used);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  out.begin("process_cpu_seconds_total", "Processor time, all threads", MetricType::Counter);
  out.add(seconds(used.ru_utime) + seconds(used.ru_stime));
  out.begin("process_resident_memory_bytes", "Resident memory");
  out.add(static_cast<double>(resident_bytes_now()));
  const auto heap = mallinfo2();
  out.begin("process_heap_bytes",
            "Of it in use by malloc: without code, stacks, and what lies free between blocks");
  out.add(static_cast<double>(heap.uordblks + heap.hblkhd));
  out.begin("process_open_fds", "Open descriptors");
  out.add(static_cast<double>(entries_of("/proc/self/fd")));
  out.begin("process_threads", "Threads");
  out.add(static_cast<double>(entries_of("/proc/self/task")));
}

HttpListener::Answer answer(Core& core, const std::string& path) {
  if (path == "/metrics") return {200, metrics_text(core), "text/plain; version=0.0.4; charset=utf-8"};
  if (path == "/livez") return {200, "alive\n"};
  if (path == "/readyz") {
    try {
      core.calls.require_ready();
      return {200, "ready\n"};
    } catch (const std::exception& error) {
      return {503, std::string(error.what()) + "\n"};
    }
  }
  if (path == "/version")
    return {200, nlohmann::json{{"version", TELETACT_VERSION}, {"api", "v1"}}.dump() + "\n",
            "application/json"};
  return {404, "there are /metrics, /livez, /readyz and /version\n"};
}

}  // namespace

std::string metrics_text(Core& core) {
  Families out(core.metrics.collect());
  add_calls(core, out);
  add_memory(core, out);
  out.begin("teletact_scenes", "Scenes");
  out.add(static_cast<double>(core.scenes.list().size()));
  add_devices(core, out);
  out.begin("teletact_uptime_seconds", "Since the service was started");
  out.add(std::chrono::duration<double>(std::chrono::steady_clock::now() - core.started).count());
  add_process(out);
  return out.text();
}

std::unique_ptr<HttpListener> listen_for_admin(const std::string& address, Core& core) {
  return std::make_unique<HttpListener>("--admin", address,
                                        [&core](const std::string& path) { return answer(core, path); });
}

}  // namespace teletact::service
