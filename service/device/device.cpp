#include "service/device/device.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <mutex>
#include <set>
#include <string>
#include <system_error>
#include <thread>
#include <utility>

#include "service/device/opencl.h"
#include "service/device/queue.h"

namespace teletact::service {

// Listing, choosing and opening devices.
namespace {

struct Found {
  cl::Device device;
  DeviceInfo info;
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
  info.gpu = (device.getInfo<CL_DEVICE_TYPE>() & CL_DEVICE_TYPE_GPU) != 0;
  info.vector_bytes =
      info.gpu ? 4 : 4 * std::clamp(device.getInfo<CL_DEVICE_NATIVE_VECTOR_WIDTH_FLOAT>(), 1U, 16U);
  info.max_group = device.getInfo<CL_DEVICE_MAX_WORK_GROUP_SIZE>();
  info.global_memory_bytes = device.getInfo<CL_DEVICE_GLOBAL_MEM_SIZE>();
  info.max_allocation_bytes = device.getInfo<CL_DEVICE_MAX_MEM_ALLOC_SIZE>();
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

constexpr std::size_t kMaxDevices = 64;

// Of those that match, the one that comes after so many.
const Found& choose(const std::vector<Found>& all, const std::string& select, std::size_t match) {
  if (all.empty()) throw DeviceError(no_device());
  if (select.empty() && match == 0) {
    const auto gpu = std::find_if(all.begin(), all.end(), [](const Found& f) { return f.info.gpu; });
    return gpu == all.end() ? all.front() : *gpu;
  }
  const bool number =
      std::all_of(select.begin(), select.end(), [](unsigned char c) { return std::isdigit(c); });
  const std::size_t before = match;
  for (const Found& found : all) {
    const bool matches = number ? select == std::to_string(found.info.index)
                                : lower(found.info.name).find(lower(select)) != std::string::npos;
    if (matches && match-- == 0) return found;
  }
  std::string known;
  for (const Found& found : all) known += " [" + std::to_string(found.info.index) + "] " + found.info.name;
  throw DeviceError((before > 0 ? "every OpenCL device that matches '" : "no OpenCL device matches '") +
                    select + (before > 0 ? "' is chosen already: name another, or leave it out" : "'") +
                    "; there are:" + known);
}

// Devices of their own, which share the memory; the first ones get the compute units that are left over. They
// are kept for as long as the process lives: PoCL 3.1 looks at a queue's device after it has released the
// queue's context, on a thread of its own, which nobody can wait for.
const std::vector<cl::Device>& parts_of(const Found& whole, std::size_t parts) {
  static std::mutex mutex;
  static auto& kept = *new std::map<std::pair<cl_device_id, std::size_t>, std::vector<cl::Device>>;
  const std::lock_guard lock(mutex);
  std::vector<cl::Device>& made = kept[{whole.device(), parts}];
  if (!made.empty()) return made;
  const std::size_t units = whole.info.compute_units;
  std::vector<cl_device_partition_property> how{CL_DEVICE_PARTITION_BY_COUNTS};
  for (std::size_t k = 0; k < parts; ++k)
    how.push_back(static_cast<cl_device_partition_property>(units / parts + (k < units % parts ? 1 : 0)));
  how.insert(how.end(), {CL_DEVICE_PARTITION_BY_COUNTS_LIST_END, 0});
  cl::Device(whole.device).createSubDevices(how.data(), &made);
  return made;
}

Found part_of(const Found& whole, std::size_t part, std::size_t parts) {
  if (parts == 1) return whole;
  const std::string words = whole.info.name + " (" + std::to_string(whole.info.compute_units) +
                            " compute units) cannot be cut into " + std::to_string(parts) + " parts";
  if (parts > whole.info.compute_units) throw DeviceError(words + "; ask for fewer");
  Found found = whole;
  try {
    found.device = parts_of(whole, parts).at(part);
  } catch (const cl::Error&) {  // most GPUs
    throw DeviceError(words + " by its driver; name it alone");
  }
  found.info.name += " " + std::to_string(part + 1) + "/" + std::to_string(parts);
  found.info.compute_units = found.device.getInfo<CL_DEVICE_MAX_COMPUTE_UNITS>();
  found.info.global_memory_bytes /= parts;
  found.info.max_allocation_bytes = std::min(found.info.max_allocation_bytes, found.info.global_memory_bytes);
  return found;
}

// PoCL starts its worker threads at the first enumeration, and threads inherit the nice value of the one that
// creates them. Hence the whole opening runs on a thread of its own.
void on_thread_of(int niceness, const std::function<void()>& work) {
  std::exception_ptr failure;
  std::thread([&] {
    try {
      if (niceness > 0) setpriority(PRIO_PROCESS, 0, niceness);
      work();
    } catch (...) {
      failure = std::current_exception();
    }
  }).join();
  if (failure) std::rethrow_exception(failure);
}

std::shared_ptr<Context> open_context(const DeviceOptions& options) {
  std::shared_ptr<Context> context;
  on_thread_of(options.niceness, [&] {
    const std::vector<Found> all = find_devices();
    Found found = part_of(choose(all, options.select, options.match), options.part, options.parts);
    found.info.has_double = found.info.has_double && !options.hide_double;
    if (options.as_gpu) found.info.gpu = true, found.info.vector_bytes = 4;
    if (options.max_array_bytes > 0)
      found.info.max_allocation_bytes = std::min(found.info.max_allocation_bytes, options.max_array_bytes);
    context = std::make_shared<Context>(found.device, found.info, options);
  });
  return context;
}

// SELECT/PARTS; a name may have a slash of its own.
void read_selection(const std::string& selection, DeviceOptions& options) {
  options.select = selection;
  const std::size_t slash = selection.rfind('/');
  if (slash == std::string::npos) return;
  const std::string parts = selection.substr(slash + 1);
  std::size_t count = 0;
  const auto [end, error] = std::from_chars(parts.data(), parts.data() + parts.size(), count);
  if (parts.empty() || end != parts.data() + parts.size()) return;
  if (error != std::errc() || count == 0 || count > kMaxDevices)
    throw DeviceError("'" + selection + "': a device is cut into 1 to " + std::to_string(kMaxDevices) +
                      " parts");
  options.select = selection.substr(0, slash);
  options.parts = count;
}

}  // namespace

std::vector<DeviceInfo> list_devices() {
  std::vector<DeviceInfo> infos;
  for (const Found& found : find_devices()) infos.push_back(found.info);
  return infos;
}

std::vector<DeviceOptions> choose_devices(const std::vector<std::string>& selections,
                                          const DeviceOptions& common) {
  std::vector<DeviceOptions> chosen;
  on_thread_of(common.niceness, [&] {
    const std::vector<Found> all = find_devices();
    std::set<std::size_t> taken;
    for (const std::string& selection : selections) {
      DeviceOptions options = common;
      read_selection(selection, options);
      while (taken.contains(choose(all, options.select, options.match).info.index)) ++options.match;
      taken.insert(choose(all, options.select, options.match).info.index);
      for (options.part = 0; options.part < options.parts; ++options.part) {
        options.number = chosen.size();
        chosen.push_back(options);
      }
    }
  });
  if (chosen.size() > kMaxDevices)
    throw DeviceError(std::to_string(chosen.size()) + " devices are more than the " +
                      std::to_string(kMaxDevices) + " that a service uses; name fewer");
  return chosen;
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

Place Device::place() const {
  return place_of_device(context_->options().number);
}

bool Device::was_tried() const {
  return context_->was_tried();
}

void Device::tried() const {
  context_->tried();
}

std::shared_ptr<const void> Device::imaging() const {
  return context_->imaging();
}

bool Device::is_imaging() const {
  return context_->imaging().use_count() > 1;
}

std::uint64_t Device::held_bytes() const {
  return *context_->held_bytes();
}

const DeviceInfo& Device::info() const {
  return context_->info();
}

namespace {

namespace fs = std::filesystem;

std::string environment(const char* name) {
  const char* value = std::getenv(name);
  return value ? value : "";
}

// OCL_ICD_VENDORS names a folder, an .icd file or a library; by default the system's folder of .icd files.
bool pocl_is_installed() {
  const std::string vendors = environment("OCL_ICD_VENDORS");
  const fs::path place = vendors.empty() ? "/etc/OpenCL/vendors" : vendors;
  std::error_code error;
  if (!fs::is_directory(place, error)) return place.string().find("pocl") != std::string::npos;
  for (const auto& entry : fs::directory_iterator(place, error)) {
    std::ifstream file(entry.path());
    std::string library;
    std::getline(file, library);
    if (library.find("pocl") != std::string::npos) return true;
  }
  return false;
}

// Where PoCL 3.1 keeps compiled kernels. It takes an empty HOME for the root folder.
fs::path pocl_cache() {
  if (const char* set = std::getenv("POCL_CACHE_DIR")) {
    if (*set == 0)  // PoCL aborts
      throw DeviceError("POCL_CACHE_DIR is set but empty: give a writable folder, or unset it");
    return set;
  }
  if (const std::string set = environment("XDG_CACHE_HOME"); !set.empty())
    return fs::path(set) / "pocl/kcache";
  if (const char* home = std::getenv("HOME")) return std::string(home) + "/.cache/pocl/kcache";
  return "/tmp/pocl/kcache";
}

bool can_write_in(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  std::string probe = (folder / "teletact-XXXXXX").string();
  const int file = mkstemp(probe.data());
  if (file < 0) return false;
  close(file);
  unlink(probe.c_str());
  return true;
}

}  // namespace

std::string no_device() {
  std::string set;
  for (const char* name : {"OCL_ICD_VENDORS", "OCL_ICD_FILENAMES", "POCL_DEVICES"})
    if (const char* value = std::getenv(name))
      set += std::string(set.empty() ? "" : ", ") + name + "=" + std::string(value).substr(0, 200);
  return "no OpenCL device: " + (set.empty() ? "" : "check or unset " + set + "; or ") +
         "install an OpenCL driver (Debian: pocl-opencl-icd)";
}

void check_runtime_environment() {
  if (!pocl_is_installed()) return;
  std::error_code error;
  for (const char* needed : {"/proc/self", "/sys/devices/system/cpu"})
    if (!fs::exists(needed, error))
      throw DeviceError(std::string("the OpenCL runtime PoCL needs ") + needed +
                        ": mount /proc and /sys in this container or chroot");
  const fs::path cache = pocl_cache();
  if (!can_write_in(cache))
    throw DeviceError("the OpenCL kernel cache folder " + cache.string() +
                      " cannot be written: set POCL_CACHE_DIR to a writable folder");
}

}  // namespace teletact::service
