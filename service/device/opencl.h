// The cl:: objects behind device.h. Private to service/device.
#pragma once

#define CL_HPP_TARGET_OPENCL_VERSION 300
#define CL_HPP_MINIMUM_OPENCL_VERSION 300
#define CL_HPP_ENABLE_EXCEPTIONS
#include <CL/opencl.hpp>
#include <array>
#include <atomic>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "service/device/device.h"

namespace teletact::service {

struct RawBuffer {
  Charge charge;  // first: returned after the buffer is gone
  cl::Buffer buffer;
  std::size_t bytes = 0;
  std::shared_ptr<std::atomic<std::uint64_t>> held;  // of the device, less this when it goes
  RawBuffer() = default;
  RawBuffer(const RawBuffer&) = delete;
  RawBuffer& operator=(const RawBuffer&) = delete;
  ~RawBuffer() {
    if (held) *held -= bytes;
  }
};

// Launches of one queue that profiling has not yet summed up. Used by the queue's thread only.
struct LaunchLog {
  bool enabled = false;
  std::vector<std::pair<std::string, cl::Event>> pending;
  std::map<std::string, KernelTime> totals;
  void collect();  // waits for the pending launches and adds them to the totals
};

// What a queue has ahead of it, on a thread that looks up (cancellation.h).
struct Pace {
  double ahead_s = 0;
};

struct RawRead {
  cl::Event event;
  std::shared_ptr<DeviceWork> work;
  ~RawRead();  // waits
};

struct RawKernel {
  cl::Kernel kernel;
  cl::CommandQueue queue;
  std::shared_ptr<LaunchLog> log;
  std::shared_ptr<Pace> pace;
  std::shared_ptr<DeviceWork> work;
  std::string name;
  bool of_pocl = false;
  std::size_t device = 0;  // its number
  using Sizes = std::array<std::size_t, 3>;
  struct Measured {
    double s = 0;
    int launches = 0;  // the first may have compiled it and says little
  };
  std::map<Sizes, Measured> measured;  // launches, by their global size
  bool cut_before = false, used_before = false;
  struct Cut {
    std::size_t along = 0, groups = 0, max = 0;  // the dimension; its groups, and how many at once
  };

  void enqueue(const Sizes& from, const Sizes& global, const Sizes& local);
  void enqueue(const Cut&, std::size_t first, std::size_t count, const Sizes& global, const Sizes& local);
  Cut cut(const Sizes& global, const Sizes& local);
  // So that no more than some 10 ms are ahead of the queue, and looks up in between.
  void launch_at_pace(const Sizes& global, const Sizes& local);
  void catch_up();
  void finish();
};

void count_compile_step();

inline constexpr const char* kPocl = "Portable Computing Language";  // its platform's name

// One device opened by the process: its programs are built at most once each.
class Context {
 public:
  Context(cl::Device, DeviceInfo, DeviceOptions);
  const DeviceInfo& info() const { return info_; }
  const DeviceOptions& options() const { return options_; }
  const cl::Context& cl() const { return context_; }
  const cl::Device& device() const { return device_; }
  const std::shared_ptr<std::atomic<std::uint64_t>>& held_bytes() const { return held_bytes_; }
  bool was_tried() const { return tried_; }
  void tried() { tried_ = true; }
  const std::shared_ptr<const void>& imaging() const { return imaging_; }
  // A new cl::Kernel. Thread-safe: OpenCL's kernel creation is not, everywhere.
  cl::Kernel kernel(const std::string& source, const std::string& name, Precision, const Defines&);

 private:
  cl::Device device_;
  DeviceInfo info_;
  DeviceOptions options_;
  cl::Context context_;
  std::shared_ptr<std::atomic<std::uint64_t>> held_bytes_ = std::make_shared<std::atomic<std::uint64_t>>(0);
  std::mutex mutex_;
  std::atomic<bool> tried_{false};
  const std::shared_ptr<const void> imaging_ = std::make_shared<bool>();
  std::map<std::string, cl::Program> programs_;  // by source name, precision and defines
};

// Runs `call`; turns a cl::Error into a DeviceError that says what was being done.
template <class Call>
auto guarded(const std::string& doing, Call&& call) {
  try {
    return call();
  } catch (const cl::Error& e) {
    if (e.err() == CL_MEM_OBJECT_ALLOCATION_FAILURE || e.err() == CL_OUT_OF_RESOURCES ||
        e.err() == CL_OUT_OF_HOST_MEMORY)
      throw DeviceMemoryError(doing + ": the device is out of memory (OpenCL error " +
                              std::to_string(e.err()) + " in " + e.what() +
                              "); ask for less at once, or lower device_memory_bytes");
    throw DeviceError(doing + ": OpenCL error " + std::to_string(e.err()) + " in " + e.what());
  }
}

}  // namespace teletact::service
