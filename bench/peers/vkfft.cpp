#include "bench/peers/vkfft.h"

#ifdef TELETACT_BENCH_VKFFT
#include <vkFFT.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <utility>
#include <vector>

#include "bench/basics/clock.h"
#include "bench/basics/median.h"

namespace teletact::bench {
namespace {

void require(bool went_well, const char* what) {
  if (!went_well) throw std::runtime_error(std::string("VkFFT's OpenCL: ") + what + " failed");
}

std::optional<std::pair<cl_platform_id, cl_device_id>> find(const std::string& name) {
  std::vector<cl_platform_id> platforms(16);
  cl_uint count = 0;
  clGetPlatformIDs(static_cast<cl_uint>(platforms.size()), platforms.data(), &count);
  platforms.resize(std::min<std::size_t>(count, platforms.size()));
  for (cl_platform_id platform : platforms) {
    std::vector<cl_device_id> devices(16);
    cl_uint of_it = 0;
    if (clGetDeviceIDs(platform, CL_DEVICE_TYPE_ALL, static_cast<cl_uint>(devices.size()), devices.data(),
                       &of_it) != CL_SUCCESS)
      continue;
    devices.resize(std::min<std::size_t>(of_it, devices.size()));
    for (cl_device_id device : devices) {
      std::string its(256, '\0');
      clGetDeviceInfo(device, CL_DEVICE_NAME, its.size(), its.data(), nullptr);
      if (its.c_str() == name) return std::pair{platform, device};
    }
  }
  return std::nullopt;
}

template <class Raw, class Release>
auto owned(Raw* raw, Release release) {
  require(raw != nullptr, "making an object");
  return std::unique_ptr<Raw, Release>(raw, release);
}

}  // namespace

std::optional<TransformFigures> measure_vkfft(const std::string& name, std::size_t nx, std::size_t nz,
                                              std::size_t planes, std::string& absent) {
  auto found = find(name);
  if (!found) {
    absent = "VkFFT sees no device " + name;
    return std::nullopt;
  }
  auto& [platform, device] = *found;
  const auto context =
      owned(clCreateContext(nullptr, 1, &device, nullptr, nullptr, nullptr), clReleaseContext);
  const auto queue = owned(clCreateCommandQueueWithProperties(context.get(), device, nullptr, nullptr),
                           clReleaseCommandQueue);
  const std::size_t pitch = nx + 2;
  std::vector<float> before(pitch * nz * planes), after(before.size());
  for (std::size_t k = 0; k < before.size(); ++k) before[k] = std::sin(0.1F * static_cast<float>(k % 1000));
  std::uint64_t bytes = before.size() * sizeof(float);
  const auto buffer =
      owned(clCreateBuffer(context.get(), CL_MEM_READ_WRITE, bytes, nullptr, nullptr), clReleaseMemObject);
  cl_context its_context = context.get();
  cl_mem its_buffer = buffer.get();
  VkFFTConfiguration configuration{};
  configuration.FFTdim = 2;
  configuration.size[0] = nx, configuration.size[1] = nz;
  configuration.numberBatches = planes;
  configuration.performR2C = 1, configuration.normalize = 1;
  configuration.platform = &platform, configuration.device = &device, configuration.context = &its_context;
  configuration.buffer = &its_buffer, configuration.bufferSize = &bytes;
  VkFFTApplication application{};
  require(initializeVkFFT(&application, configuration) == VKFFT_SUCCESS, "setting up");
  const std::shared_ptr<void> ended(nullptr, [&](void*) { deleteVkFFT(&application); });
  cl_command_queue its_queue = queue.get();
  VkFFTLaunchParams launch{};
  launch.commandQueue = &its_queue, launch.buffer = &its_buffer;
  const auto there_and_back = [&] {
    require(VkFFTAppend(&application, -1, &launch) == VKFFT_SUCCESS &&
                VkFFTAppend(&application, 1, &launch) == VKFFT_SUCCESS,
            "a transform");
  };
  require(clEnqueueWriteBuffer(its_queue, its_buffer, CL_TRUE, 0, bytes, before.data(), 0, nullptr,
                               nullptr) == CL_SUCCESS,
          "a copy");
  there_and_back();
  require(clEnqueueReadBuffer(its_queue, its_buffer, CL_TRUE, 0, bytes, after.data(), 0, nullptr, nullptr) ==
              CL_SUCCESS,
          "a copy");
  TransformFigures out;
  for (std::size_t k = 0; k < before.size(); ++k)
    if (k % pitch < nx) out.off = std::max(out.off, std::abs(double{after[k]} - double{before[k]}));
  constexpr int kRounds = 15, kOfARound = 10;
  std::vector<double> s;
  for (int round = 0; round < kRounds; ++round)
    s.push_back(seconds_of([&] {
                  for (int k = 0; k < kOfARound; ++k) there_and_back();
                  clFinish(its_queue);
                }) /
                kOfARound);
  out.s = median_of(s);
  return out;
}

}  // namespace teletact::bench
#else
namespace teletact::bench {

std::optional<TransformFigures> measure_vkfft(const std::string&, std::size_t, std::size_t, std::size_t,
                                              std::string& absent) {
  absent = "VkFFT is not installed (libvkfft-dev)";
  return std::nullopt;
}

}  // namespace teletact::bench
#endif
