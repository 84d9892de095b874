// Listing, choosing and opening devices.
#include "service/device/device.h"

#include <sys/resource.h>

#include <algorithm>
#include <cctype>
#include <exception>
#include <thread>

#include "service/device/environment.h"
#include "service/device/opencl.h"
#include "service/device/queue.h"

namespace teletact::service {
namespace {

struct Found {
  cl::Device device;
  DeviceInfo info;
  bool gpu = false;
};

// OpenCL strings may carry their terminating zero and blanks.
std::string trimmed(std::string text) {
  const auto unwanted = [](unsigned char c) { return c == 0 || std::isspace(c); };
  while (!text.empty() && unwanted(text.back())) text.pop_back();
  text.erase(text.begin(), std::find_if_not(text.begin(), text.end(), unwanted));
  return text;
}

Found describe(const cl::Platform& platform, const cl::Device& device, std::size_t index) {
  Found found;
  found.device = device;
  DeviceInfo& info = found.info;
  info.index = index;
  info.name = trimmed(device.getInfo<CL_DEVICE_NAME>());
  info.vendor = trimmed(device.getInfo<CL_DEVICE_VENDOR>());
  info.platform = trimmed(platform.getInfo<CL_PLATFORM_NAME>());
  info.version = trimmed(device.getInfo<CL_DEVICE_VERSION>());
  info.driver_version = trimmed(device.getInfo<CL_DRIVER_VERSION>());
  info.has_double = device.getInfo<CL_DEVICE_DOUBLE_FP_CONFIG>() != 0;
  info.compute_units = device.getInfo<CL_DEVICE_MAX_COMPUTE_UNITS>();
  info.vector_bytes = 4 * std::clamp(device.getInfo<CL_DEVICE_NATIVE_VECTOR_WIDTH_FLOAT>(), 1U, 16U);
  info.max_group = device.getInfo<CL_DEVICE_MAX_WORK_GROUP_SIZE>();
  info.global_memory_bytes = device.getInfo<CL_DEVICE_GLOBAL_MEM_SIZE>();
  info.max_allocation_bytes = device.getInfo<CL_DEVICE_MAX_MEM_ALLOC_SIZE>();
  found.gpu = (device.getInfo<CL_DEVICE_TYPE>() & CL_DEVICE_TYPE_GPU) != 0;
  return found;
}

std::vector<Found> find_devices() {
  check_runtime_environment();
  std::vector<cl::Platform> platforms;
  try {
    cl::Platform::get(&platforms);
  } catch (const cl::Error&) {
    return {};  // CL_PLATFORM_NOT_FOUND_KHR: no runtime installed
  }
  std::vector<Found> all;
  for (const cl::Platform& platform : platforms) {
    std::vector<cl::Device> devices;
    try {
      platform.getDevices(CL_DEVICE_TYPE_ALL, &devices);
    } catch (const cl::Error&) {
      continue;  // a platform without devices
    }
    for (const cl::Device& device : devices)
      all.push_back(guarded("asking for a device's properties",
                            [&] { return describe(platform, device, all.size()); }));
  }
  return all;
}

std::string lower(std::string text) {
  for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return text;
}

const Found& choose(const std::vector<Found>& all, const std::string& select) {
  if (all.empty()) throw DeviceError("no OpenCL device: install an OpenCL driver (Debian: pocl-opencl-icd)");
  if (select.empty()) {
    const auto gpu = std::find_if(all.begin(), all.end(), [](const Found& f) { return f.gpu; });
    return gpu == all.end() ? all.front() : *gpu;
  }
  const bool number =
      std::all_of(select.begin(), select.end(), [](unsigned char c) { return std::isdigit(c); });
  for (const Found& found : all) {
    if (number && select == std::to_string(found.info.index)) return found;
    if (!number && lower(found.info.name).find(lower(select)) != std::string::npos) return found;
  }
  std::string known;
  for (const Found& found : all) known += " [" + std::to_string(found.info.index) + "] " + found.info.name;
  throw DeviceError("no OpenCL device matches '" + select + "'; there are:" + known);
}

// PoCL starts its worker threads at the first enumeration, and threads inherit the nice value of the one that
// creates them. Hence the whole opening runs on a thread of its own.
std::shared_ptr<Context> open_context(const DeviceOptions& options) {
  std::shared_ptr<Context> context;
  std::exception_ptr failure;
  std::thread([&] {
    try {
      if (options.niceness > 0) setpriority(PRIO_PROCESS, 0, options.niceness);
      const std::vector<Found> all = find_devices();
      Found found = choose(all, options.select);
      found.info.has_double = found.info.has_double && !options.hide_double;
      if (options.most_array_bytes > 0)
        found.info.max_allocation_bytes = std::min(found.info.max_allocation_bytes, options.most_array_bytes);
      context = std::make_shared<Context>(found.device, found.info, options);
    } catch (...) {
      failure = std::current_exception();
    }
  }).join();
  if (failure) std::rethrow_exception(failure);
  return context;
}

}  // namespace

std::vector<DeviceInfo> list_devices() {
  std::vector<DeviceInfo> infos;
  for (const Found& found : find_devices()) infos.push_back(found.info);
  return infos;
}

std::shared_ptr<Device> Device::open(const DeviceOptions& options) {
  auto device = std::make_shared<Device>();
  device->context_ = open_context(options);
  return device;
}

Queue Device::queue(const MemoryAccount& account) const {
  Queue queue;
  queue.state_ = std::make_shared<Queue::State>(context_);
  queue.state_->account = account;
  return queue;
}

std::uint64_t Device::held_bytes() const {
  return *context_->held_bytes();
}

const DeviceInfo& Device::info() const {
  return context_->info();
}

}  // namespace teletact::service
