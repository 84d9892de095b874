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
  KernelProfile profile{device_->info().name, bytes_s_, flops_s_, {}};
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
}

}  // namespace teletact::bench
