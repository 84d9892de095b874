// A stage on a device: its time, what it asks for, its kernels against what the device can.
#include <algorithm>
#include <cstdio>

#include "bench/basics/clock.h"
#include "bench/basics/gpu_model.h"
#include "bench/basics/median.h"
#include "bench/suites/device/device.h"

namespace teletact::bench {
namespace {

constexpr double kLongS = 1e-4;  // of a run: shorter kernels are left out
constexpr double kMostS = 3;     // of a stage, once there are kLeast
constexpr int kLeast = 3, kMost = 31;

double seconds_each(const DeviceStage& stage) {
  const auto once = [&stage](const std::function<void()>& work) {
    return work ? seconds_of([&] {
      work();
      stage.queue.finish();
    })
                : 0.0;
  };
  std::vector<double> seconds;
  for (const Clock::time_point begin = Clock::now();
       seconds.size() < kLeast || (seconds.size() < kMost && seconds_since(begin) < kMostS);)
    seconds.push_back((once(stage.run) - once(stage.less)) / stage.times);
  return median_of(seconds);
}

service::DeviceWork work_of(const DeviceStage& stage, const std::function<void()>& run) {
  if (!run) return {};
  stage.queue.take_work();
  run();
  return stage.queue.take_work();
}

// Of one run; compiled before.
std::vector<KernelFigures> profile(const DeviceStage& stage, const std::function<void()>& run,
                                   const DeviceLimits& limits) {
  if (!run) return {};
  std::map<std::string, service::KernelTime> before;
  for (const service::KernelTime& t : stage.queue.profile()) before[t.name] = t;
  run();
  std::vector<KernelFigures> kernels;
  for (const service::KernelTime& t : stage.queue.profile()) {
    const double launches = double(t.launches) - double(before[t.name].launches),
                 seconds = t.seconds - before[t.name].seconds;
    if (launches == 0) continue;
    KernelFigures k{stage.stage, t.name, launches, 1e3 * seconds, kNan, kNan, kNan, ""};
    if (const auto found = stage.works.find(t.name); found != stage.works.end()) {
      const double bytes = launches * found->second.bytes, flops = launches * found->second.flops;
      k.gb_s = 1e-9 * bytes / seconds, k.gflop_s = 1e-9 * flops / seconds;
      const double memory_s = bytes / limits.triad_bytes_s, arithmetic_s = flops / limits.flops_s;
      if (limits.triad_bytes_s > 0)
        k.bound = memory_s >= arithmetic_s ? "memory" : "arithmetic",
        k.of_limit = std::max(memory_s, arithmetic_s) / seconds;
    }
    kernels.push_back(std::move(k));
  }
  std::sort(kernels.begin(), kernels.end(), [](const auto& a, const auto& b) { return a.ms > b.ms; });
  return kernels;
}

}  // namespace

DevicePart::Device DevicePart::open() const {
  return service::Device::open(options);
}

void DevicePart::measure(const std::function<DeviceStage(const Device&)>& make) {
  const Device device = open();
  DeviceStage stage = make(device);
  work_of(stage, stage.less);
  work_of(stage, stage.run);  // compile
  const double seconds = seconds_each(stage);
  add_stage(options, stage.stage, seconds, make);
  if (device->info().gpu) return;
  service::DeviceOptions as_gpu = options;
  as_gpu.as_gpu = true;
  add_stage(as_gpu, stage.stage + ", as a GPU", kNan, make);
}

void DevicePart::add_stage(service::DeviceOptions how, const std::string& name, double seconds,
                           const std::function<DeviceStage(const Device&)>& make) {
  how.profiling = true;
  const Device device = service::Device::open(how);
  DeviceStage stage = make(device);
  stage.stage = name;
  work_of(stage, stage.run);  // compiles
  const std::vector<KernelFigures> kernels = profile(stage, stage.run, limits);
  const service::DeviceWork all = stage.queue.take_work();
  double moved = 0;
  for (const KernelFigures& k : profile(stage, stage.less, limits))
    if (k.gb_s > 0) moved -= 1e6 * k.gb_s * k.ms;
  const service::DeviceWork less = stage.queue.take_work();
  const auto each = [&](std::uint64_t service::DeviceWork::*count) {
    return (double(all.*count) - double(less.*count)) / stage.times;
  };
  using W = service::DeviceWork;
  DeviceStageFigures f{name,
                       1e3 * seconds,
                       each(&W::launches),
                       each(&W::copies),
                       each(&W::waits),
                       each(&W::looks),
                       1e-6 * each(&W::bytes_to),
                       1e-6 * each(&W::bytes_from),
                       double(all.longest_chain),
                       kNan};
  for (const KernelFigures& k : kernels) {
    if (k.gb_s > 0) moved += 1e6 * k.gb_s * k.ms;
    if (seconds > 0 && 1e-3 * k.ms >= kLongS) add("kernels", k);
  }
  if (device->info().gpu)
    f.a_gpu_modelled_ms = 1e3 * GpuModel{}.seconds(f.launches + f.copies, f.waits, each(&W::chained),
                                                   moved / stage.times, 1e6 * (f.mb_to + f.mb_from));
  add("stages", f);
  std::printf("%-60s %4.0f launches %3.0f waits  chain %6.0f", f.stage.c_str(), f.launches, f.waits,
              f.longest_chain);
  if (seconds > 0) std::printf("  %.3f ms", f.ms);
  if (device->info().gpu) std::printf("  a GPU, modelled: %.3f ms", f.a_gpu_modelled_ms);
  std::printf("\n");
  std::fflush(stdout);
}

}  // namespace teletact::bench
