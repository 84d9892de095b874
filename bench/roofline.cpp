#include "bench/roofline.h"

#include <algorithm>
#include <cstdio>

#include "bench/basics/clock.h"
#include "bench/basics/median.h"

namespace teletact::bench {
namespace {

double at_best(int repeats, auto&& once) {
  once();  // compiles
  double least = 1e300;
  for (int k = 0; k < repeats; ++k) least = std::min(least, seconds_of(once));
  return least;
}

// A GPU's time, of an H100: on it one iteration of 70 k serial terms took 0.7 to 1.3 ms, of 336 k 3 to 5 ms.
constexpr double kLaunchS = 6e-6, kWaitS = 15e-6, kTermS = 15e-9, kMemoryBytesS = 2.5e12, kLinkBytesS = 12e9;

RunWork work_of(const service::DeviceWork& all, const std::vector<KernelFigures>& kernels, int runs) {
  const auto each = [runs](std::uint64_t count) { return static_cast<double>(count) / runs; };
  RunWork w{each(all.launches),
            each(all.copies),
            each(all.waits),
            each(all.looks),
            each(all.bytes_to),
            each(all.bytes_from),
            static_cast<double>(all.longest_chain)};
  double moved = 0;
  for (const KernelFigures& k : kernels) moved += k.bytes > 0 ? k.bytes : 0;
  w.model_s = (w.launches + w.copies) * kLaunchS + w.waits * kWaitS + each(all.chained) * kTermS +
              moved / kMemoryBytesS + (w.bytes_to + w.bytes_from) / kLinkBytesS;
  return w;
}

}  // namespace

DeviceFigures describe(const service::DeviceInfo& info) {
  return {info.name, info.driver_version, info.compute_units};
}

ProfiledDevice::ProfiledDevice(std::size_t index) {
  constexpr std::size_t kVectors = std::size_t{1} << 20, kItems = 1 << 14;  // 32 MiB an array
  constexpr int kChains = 8, kSteps = 256, kRepeats = 40;                   // chains of roofline.cl
  service::DeviceOptions options;
  options.select = std::to_string(index);
  options.kernel_directory = TELETACT_BENCH_KERNELS;
  const service::Queue queue = service::Device::open(options)->queue();
  const auto a = queue.array<float>(8 * kVectors);
  auto b = queue.array<float>(8 * kVectors), c = queue.array<float>(8 * kVectors);
  queue.fill_zero(b), queue.fill_zero(c);
  auto triad = queue.kernel("roofline", "triad", service::Precision::kFloat);
  auto chains = queue.kernel("roofline", "multiply_add", service::Precision::kFloat);
  bytes_s_ = 3.0 * 32 * kVectors / at_best(kRepeats, [&] {
               triad({{kVectors}, {64}}, b, c, a, 0.5f, static_cast<int>(kVectors));
               queue.finish();
             });
  flops_s_ = 16.0 * kChains * kSteps * kItems / at_best(kRepeats, [&] {
               chains({{kItems}, {64}}, a, 0.999f, kSteps);
               queue.finish();
             });
  options.kernel_directory.clear();
  options.profiling = true;
  device_ = service::Device::open(options);
}

KernelProfile ProfiledDevice::profile(const service::Queue& queue, const Works& work, int runs) const {
  KernelProfile profile{device_->info().name, bytes_s_, flops_s_, {}, {}};
  for (const service::KernelTime& t : queue.profile()) {
    KernelFigures k{t.name, t.seconds / runs, static_cast<double>(t.launches) / runs, kNan, kNan, "", kNan};
    if (const auto found = work.find(t.name); found != work.end()) {
      k.bytes = k.launches * found->second.bytes;
      k.flops = k.launches * found->second.flops;
      const double memory_s = k.bytes / bytes_s_, arithmetic_s = k.flops / flops_s_;
      k.bound = memory_s > arithmetic_s ? "memory" : "arithmetic";
      k.of_limit = std::max(memory_s, arithmetic_s) / k.seconds;
    }
    profile.kernels.push_back(std::move(k));
  }
  profile.work = work_of(queue.take_work(), profile.kernels, runs);
  std::sort(profile.kernels.begin(), profile.kernels.end(),
            [](const auto& a, const auto& b) { return a.seconds > b.seconds; });
  return profile;
}

void print(const KernelProfile& profile) {
  double seconds = 0;
  for (const KernelFigures& k : profile.kernels) seconds += k.seconds;
  std::printf("%s: %.1f GB/s and %.0f GFLOP/s (float) measured at most\n", profile.device.c_str(),
              1e-9 * profile.bytes_s, 1e-9 * profile.flops_s);
  std::printf("  %-20s %6s %9s %8s %9s %9s %10s\n", "kernel", "share", "launches", "ms", "GB/s", "GFLOP/s",
              "of limit");
  for (const KernelFigures& k : profile.kernels) {
    std::printf("  %-20s %4.0f %% %9.1f %8.3f", k.kernel.c_str(), 100 * k.seconds / seconds, k.launches,
                1e3 * k.seconds);
    if (!k.bound.empty())
      std::printf(" %9.1f %9.1f %6.0f %% %s", 1e-9 * k.bytes / k.seconds, 1e-9 * k.flops / k.seconds,
                  100 * k.of_limit, k.bound.c_str());
    std::printf("\n");
  }
  const RunWork& w = profile.work;
  std::printf(
      "  a run: %.0f launches, %.0f copies, %.0f waits, %.0f looks; %.2f MB there, %.2f MB back; longest "
      "chain "
      "%.0f; model of a GPU: %.2f ms\n",
      w.launches, w.copies, w.waits, w.looks, 1e-6 * w.bytes_to, 1e-6 * w.bytes_from, w.longest_chain,
      1e3 * w.model_s);
}

}  // namespace teletact::bench
