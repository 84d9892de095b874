// What the device can do at most: launches, waits, copies, memory, arithmetic, serial sums.
#define CL_HPP_TARGET_OPENCL_VERSION 300
#define CL_HPP_MINIMUM_OPENCL_VERSION 300
#define CL_HPP_ENABLE_EXCEPTIONS
#include <CL/opencl.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>

#include "bench/basics/clock.h"
#include "bench/suite.h"
#include "bench/suites/device/device.h"

namespace teletact::bench {
namespace {

double at_best(int repeats, auto&& once) {
  once();  // compiles
  double least = 1e300;
  for (int k = 0; k < repeats; ++k) least = std::min(least, seconds_of(once));
  return least;
}

// Arrays of a triad that moves more than 1 GB, where the device has twelve times one of them.
constexpr std::size_t kTriadArray = std::size_t{384} << 20, kArraysOfMemory = 12;
constexpr std::size_t kCopied = std::size_t{64} << 20, kQuickBytes = std::size_t{16} << 20;
constexpr int kRepeats = 7, kLaunches = 200;

void measure_memory(const service::Queue& queue, const service::Defines& wide, std::size_t floats, bool quick,
                    DeviceLimits& limits) {
  constexpr int kAtOnce = 8;  // launches of a wait, so that its time shows little
  const service::DeviceInfo& info = queue.info();
  const std::size_t bytes =
      std::min<std::size_t>({quick ? kQuickBytes : kTriadArray, info.max_allocation_bytes,
                             info.global_memory_bytes / kArraysOfMemory});
  const std::size_t vectors = bytes / sizeof(float) / floats;
  const auto a = queue.array<float>(vectors * floats);
  auto b = queue.array<float>(a.size()), c = queue.array<float>(a.size());
  queue.fill_zero(b), queue.fill_zero(c);
  auto triad = queue.kernel("limits", "triad", service::Precision::kFloat, wide);
  limits.triad_bytes = double(a.bytes());
  limits.triad_bytes_s = kAtOnce * 3.0 * double(a.bytes()) / at_best(quick ? 2 : kRepeats, [&] {
                           for (int k = 0; k < kAtOnce; ++k)
                             triad({{vectors}, {64}}, b, c, a, 0.5f, static_cast<int>(vectors));
                           queue.finish();
                         });
}

void measure_arithmetic(const service::Queue& queue, const service::Defines& wide, std::size_t floats,
                        DeviceLimits& limits) {
  // As many items as keep the units busy, and a millisecond of steps.
  const std::size_t items = queue.info().gpu ? std::size_t{1} << 20 : std::size_t{1} << 14;
  constexpr int kSteps = 256, kChains = 8, kTerms = 1 << 16;
  const auto out = queue.array<float>(items * floats);
  auto chains = queue.kernel("limits", "multiply_add", service::Precision::kFloat, wide);
  limits.flops_s = 2.0 * kChains * kSteps * double(items * floats) / at_best(kRepeats, [&] {
                     chains({{items}, {64}}, out, 0.999f, kSteps);
                     queue.finish();
                   });
  auto terms = queue.array<float>(kTerms);
  queue.fill_zero(terms);
  auto serial = queue.kernel("limits", "serial_sum", service::Precision::kFloat, wide);
  limits.serial_term_s = at_best(kRepeats,
                                 [&] {
                                   serial({{1}, {1}}, terms, out, kTerms);
                                   queue.finish();
                                 }) /
                         kTerms;
}

void measure_calls(const service::Queue& queue, const service::Defines& wide, DeviceLimits& limits) {
  const auto one = queue.array<float>(8);
  auto small = queue.kernel("limits", "serial_sum", service::Precision::kFloat, wide);
  const auto launch = [&] { small({{1}, {1}}, one, one, 0); };
  limits.launch_s = at_best(kRepeats,
                            [&] {
                              for (int k = 0; k < kLaunches; ++k) launch();
                              queue.finish();
                            }) /
                    kLaunches;
  limits.wait_s = at_best(kLaunches,
                          [&] {
                            launch();
                            queue.finish();
                          }) -
                  limits.launch_s;
}

// The product has no pinned memory: this asks OpenCL itself.
void measure_copies(const service::DeviceInfo& info, std::size_t bytes, DeviceLimits& limits) try {
  std::vector<cl::Platform> platforms;
  cl::Platform::get(&platforms);
  std::vector<cl::Device> all;
  for (const cl::Platform& platform : platforms) {
    std::vector<cl::Device> devices;
    try {
      platform.getDevices(CL_DEVICE_TYPE_ALL, &devices);
    } catch (const cl::Error&) {  // it has none
      continue;
    }
    all.insert(all.end(), devices.begin(), devices.end());
  }
  const cl::Device& device = all.at(info.index);
  const cl::Context context(device);
  const cl::CommandQueue queue(context, device);
  const cl::Buffer there(context, CL_MEM_READ_WRITE, bytes),
      pinned(context, CL_MEM_READ_WRITE | CL_MEM_ALLOC_HOST_PTR, bytes);
  void* const mapped = queue.enqueueMapBuffer(pinned, CL_TRUE, CL_MAP_READ | CL_MAP_WRITE, 0, bytes);
  std::vector<std::byte> pageable(bytes);
  const auto rate = [&](auto&& copy) { return double(bytes) / at_best(kRepeats, copy); };
  const auto to = [&](void* host) {
    return rate([&, host] { queue.enqueueWriteBuffer(there, CL_TRUE, 0, bytes, host); });
  };
  const auto from = [&](void* host) {
    return rate([&, host] { queue.enqueueReadBuffer(there, CL_TRUE, 0, bytes, host); });
  };
  limits.pinned_to_bytes_s = to(mapped), limits.pinned_from_bytes_s = from(mapped);
  limits.pageable_to_bytes_s = to(pageable.data()), limits.pageable_from_bytes_s = from(pageable.data());
  queue.enqueueUnmapMemObject(pinned, mapped);
  queue.finish();
} catch (const cl::Error& e) {
  throw BenchError(std::string("copies: OpenCL error ") + std::to_string(e.err()) + " in " + e.what());
}

}  // namespace

DeviceLimits measure_limits(const service::DeviceOptions& of, bool quick) {
  service::DeviceOptions options = of;
  // Beside the program, wherever that was built.
  options.kernel_directory = std::filesystem::read_symlink("/proc/self/exe").parent_path() / "kernels";
  const service::Queue queue = service::Device::open(options)->queue();
  const std::size_t floats = queue.info().gpu ? 4 : 8;
  const service::Defines wide{{"WIDE", std::to_string(floats)}};
  DeviceLimits limits;
  measure_calls(queue, wide, limits);
  measure_copies(queue.info(), quick ? kQuickBytes : kCopied, limits);
  measure_memory(queue, wide, floats, quick, limits);
  measure_arithmetic(queue, wide, floats, limits);
  std::printf(
      "launch %.1f us, wait %.1f us, serial term %.1f ns; triad of 3 x %.0f MB %.1f GB/s, %.0f GFLOP/s "
      "(float)\ncopies there and back: pinned %.1f, %.1f GB/s; pageable %.1f, %.1f GB/s\n",
      1e6 * limits.launch_s, 1e6 * limits.wait_s, 1e9 * limits.serial_term_s, 1e-6 * limits.triad_bytes,
      1e-9 * limits.triad_bytes_s, 1e-9 * limits.flops_s, 1e-9 * limits.pinned_to_bytes_s,
      1e-9 * limits.pinned_from_bytes_s, 1e-9 * limits.pageable_to_bytes_s,
      1e-9 * limits.pageable_from_bytes_s);
  return limits;
}

}  // namespace teletact::bench
