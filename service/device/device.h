// OpenCL behind one small door: choosing a device, building kernels with a disk cache, buffers, launches,
// profiling. The only folder that knows cl::; everything above speaks of arrays and kernels.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "service/base/memory.h"

namespace teletact::service {

// Failure of the OpenCL runtime or a missing device; what() is one line a person can act on.
struct DeviceError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// The device has no room for it, or its runtime says so: less can be asked for, nothing is broken.
struct DeviceMemoryError : DeviceError {
  using DeviceError::DeviceError;
};

enum class Precision { kFloat, kDouble };  // the `real` of a kernel program

struct DeviceInfo {
  std::size_t index = 0;  // position in list_devices()
  std::string name, vendor, platform, version, driver_version;
  bool has_double = false;
  bool gpu = false;  // kernels take the ways of a GPU: one number an item, work-groups that share memory
  std::uint32_t compute_units = 0;
  std::uint32_t vector_bytes = 4;  // that an instruction takes at once; of one float on a GPU
  std::size_t max_group = 1;       // work-items in a work-group
  std::uint64_t global_memory_bytes = 0, max_allocation_bytes = 0;
  // How many T an instruction adds at once.
  template <class T>
  std::size_t width() const {
    return vector_bytes > sizeof(T) ? vector_bytes / sizeof(T) : 1;
  }
};

struct DeviceOptions;

// The options of each device that `selections` name, in their order: `common` with `number` and what chooses
// it alone. A selection is DeviceOptions::select, the next device of that name where it comes again, or one
// of the form SELECT/PARTS: each of so many equal parts of a device. Throws DeviceError, one line: nothing
// matches, a device is taken twice, or cannot be cut so.
std::vector<DeviceOptions> choose_devices(const std::vector<std::string>& selections,
                                          const DeviceOptions& common);

// Every OpenCL device of every platform; empty when there is none. Checks first what PoCL needs to survive
// (a writable kernel cache folder, /proc and /sys) and throws DeviceError naming it.
std::vector<DeviceInfo> list_devices();

// Build parameters of a kernel program, passed as -DNAME=VALUE.
using Defines = std::map<std::string, std::string>;

class Context;     // the cl:: objects of one device, shared
struct RawBuffer;  // cl::Buffer
struct RawKernel;  // cl::Kernel and its queue

// n items of T in device memory. Movable, not copyable. Reads and writes go through the queue.
template <class T>
class Array {
 public:
  Array() = default;
  std::size_t size() const { return size_; }
  std::size_t bytes() const { return size_ * sizeof(T); }
  explicit operator bool() const { return raw_ != nullptr; }

 private:
  friend class Queue;
  friend class Kernel;
  std::shared_ptr<RawBuffer> raw_;
  std::size_t size_ = 0;
};

// Work sizes of a launch. The global size is rounded up to a multiple of the local one: kernels check bounds.
// Sizes left out, as in {{n}, {64}}, are 1; nothing is launched when global[0] is 0.
struct Range {
  std::array<std::size_t, 3> global{1, 1, 1};
  std::array<std::size_t, 3> local{1, 1, 1};
  std::size_t chain = 1;  // terms that one item adds up or eliminates one after the other, for DeviceWork
};

// What a queue has asked of its device.
struct DeviceWork {
  std::uint64_t launches = 0, copies = 0;  // commands that return at once: kernels; copies and fills
  std::uint64_t waits = 0;                 // calls that return when the device has nothing left to do
  std::uint64_t looks = 0;                 // waits while it still has: of fetch()
  std::uint64_t bytes_to = 0, bytes_from = 0;
  std::uint64_t longest_chain = 0, chained = 0;  // of all launches; the sum of theirs
};

// Local memory argument of a kernel.
struct Local {
  std::size_t bytes = 0;
};

// One kernel on one queue; not thread-safe (it holds its arguments).
class Kernel {
 public:
  Kernel() = default;
  // Sets the arguments in order and enqueues; returns at once. Arguments: Array<T>, Local, values of exactly
  // the kernel's type (int, float, double, unsigned, std::uint64_t ...), and structs that the kernel declares
  // alike; those of 4-byte members are laid out alike everywhere.
  template <class... Args>
  void operator()(const Range& range, const Args&... args) {
    unsigned index = 0;
    (set(index++, args), ...);
    launch(range);
  }

 private:
  friend class Queue;
  template <class T>
  void set(unsigned index, const Array<T>& array) {
    set_buffer(index, array.raw_.get());
  }
  void set(unsigned index, const Local& local) { set_bytes(index, nullptr, local.bytes); }
  template <class T>
  requires std::is_arithmetic_v<T> ||
      (std::is_class_v<T>&& std::is_trivially_copyable_v<T>)void set(unsigned index, const T& value) {
    set_bytes(index, &value, sizeof(T));
  }
  void set_buffer(unsigned index, const RawBuffer* buffer);
  void set_bytes(unsigned index, const void* data, std::size_t bytes);
  void launch(const Range& range);
  std::shared_ptr<RawKernel> raw_;
};

// Seconds and launches per kernel name, when profiling is on.
struct KernelTime {
  std::string name;
  std::uint64_t launches = 0;
  double seconds = 0;
};

struct RawRead;  // cl::Event
// A read on its way. Its host memory must live until it is here; at the end of its life it waits.
class Arrival {
 public:
  Arrival() = default;
  void wait();

 private:
  friend class Queue;
  std::shared_ptr<RawRead> raw_;
};

// An in-order command queue. One thread at a time. Several queues may work on one device.
class Queue {
 public:
  Queue() = default;
  template <class T>
  Array<T> array(std::size_t size) const {  // uninitialised
    return make<T>(size, nullptr);
  }
  template <class T>
  Array<T> array(const std::vector<T>& host) const {
    return make(host.size(), host.data());
  }
  // Blocking copies of `count` items from item `offset` on.
  template <class T>
  void write(Array<T>& a, const T* host, std::size_t count, std::size_t offset = 0) const {
    write_bytes(*a.raw_, host, count * sizeof(T), offset * sizeof(T));
  }
  template <class T>
  void read(const Array<T>& a, T* host, std::size_t count, std::size_t offset = 0) const {
    read_bytes(*a.raw_, host, count * sizeof(T), offset * sizeof(T));
  }
  template <class T>
  std::vector<T> read(const Array<T>& a) const {
    std::vector<T> host(a.size());
    read(a, host.data(), host.size());
    return host;
  }
  // As read, but it returns at once. What is asked for next follows while the items are on their way.
  template <class T>
  [[nodiscard]] Arrival fetch(const Array<T>& a, T* host, std::size_t count) const {
    return fetch_bytes(*a.raw_, host, count * sizeof(T));
  }
  // As write, but it returns at once: the items, or a copy of them, are held until they have arrived.
  template <class T>
  void send(Array<T>& a, const std::shared_ptr<std::vector<T>>& host, std::size_t offset = 0) const {
    send_bytes(*a.raw_, host, host->data(), host->size() * sizeof(T), offset * sizeof(T));
  }
  template <class T>
  void send(Array<T>& a, std::vector<T> host, std::size_t offset = 0) const {
    send(a, std::make_shared<std::vector<T>>(std::move(host)), offset);
  }
  template <class T>
  void send(Array<T>& a, const T* host, std::size_t count, std::size_t offset = 0) const {
    send(a, std::vector<T>(host, host + count), offset);
  }
  template <class T>
  void copy(const Array<T>& from, Array<T>& to) const {
    copy_bytes(*from.raw_, *to.raw_, from.bytes());
  }
  template <class T>
  void fill_zero(Array<T>& a) const {
    zero_bytes(*a.raw_, a.bytes());
  }
  // Kernel `name` of program `source` (file name in kernels/, without .cl), built at most once for each
  // (source, precision, defines) on this device, from the disk cache where possible.
  Kernel kernel(std::string_view source, std::string_view name, Precision precision,
                const Defines& = {}) const;
  void finish() const;
  std::vector<KernelTime> profile() const;  // empty unless opened with profiling
  DeviceWork take_work() const;             // since the last time
  const DeviceInfo& info() const;
  Place place() const;  // as its device's
  bool supports(Precision precision) const;
  // In whose name the arrays are held that are made from now on: their bytes are charged before they are
  // allocated (MemoryRefused).
  void charge_to(const MemoryAccount&) const;
  const MemoryAccount& account() const;

 private:
  friend class Device;
  template <class T>
  Array<T> make(std::size_t size, const T* host) const {
    Array<T> a;
    a.raw_ = allocate(size * sizeof(T), host);
    a.size_ = size;
    return a;
  }
  // Filled from `host` unless that is null.
  std::shared_ptr<RawBuffer> allocate(std::size_t bytes, const void* host) const;
  void write_bytes(RawBuffer&, const void*, std::size_t bytes, std::size_t offset) const;
  void read_bytes(const RawBuffer&, void*, std::size_t bytes, std::size_t offset) const;
  Arrival fetch_bytes(const RawBuffer&, void*, std::size_t bytes) const;
  void send_bytes(RawBuffer&, std::shared_ptr<const void> held, const void*, std::size_t bytes,
                  std::size_t offset) const;
  void copy_bytes(const RawBuffer&, RawBuffer&, std::size_t bytes) const;
  void zero_bytes(RawBuffer&, std::size_t bytes) const;
  struct State;
  std::shared_ptr<State> state_;
};

struct DeviceOptions {
  std::string select = {};  // "" = first GPU, else first device; a number = index; else part of the name
  std::size_t match = 0;    // of those whose name has it, which
  std::size_t part = 0, parts = 1;  // of so many parts that it is cut into, which: a device of its own
  std::size_t number = 0;  // of the devices that the process uses: whose budget its arrays are charged to
  std::string kernel_directory = {};  // "" = embedded sources; else read .cl files from there (development)
  std::string cache_directory =
      {};  // "" = $XDG_CACHE_HOME/teletact or ~/.cache/teletact, or PoCL's own; "none" = no disk cache
  bool profiling = false;
  std::uint64_t max_array_bytes = 0;  // 0 = what the device allows; less, as tests of full memory must
  bool hide_double = false;           // treat the device as one without double precision, as tests must
  bool as_gpu = false;                // and a processor as a GPU
  // Nice value of the runtime's worker threads (PoCL), so that touch runs before imaging. PoCL starts them at
  // the process's first use of OpenCL, list_devices() included: it takes effect only when this is that.
  int niceness = 0;
};

// Programs that this process has built, and kernels that it has launched: at their first launch PoCL compiles
// them.
std::size_t compile_steps();

// One opened device. Thread-safe.
class Device {
 public:
  static std::shared_ptr<Device> open(const DeviceOptions& = {});
  Queue queue(const MemoryAccount& = {}) const;
  const DeviceInfo& info() const;
  Place place() const;  // whose budget its arrays are charged to
  // Whether all kernels of imaging and touch have been run on it: compiled, that is.
  bool was_tried() const;
  void tried() const;
  // To be held while an estimate is under way on it, and whether anybody does.
  std::shared_ptr<const void> imaging() const;
  bool is_imaging() const;
  // Of all arrays that live now.
  std::uint64_t held_bytes() const;

 private:
  std::shared_ptr<Context> context_;
};

// A device that no longer takes work, for tests: while it is set every launch fails, on every device or on
// those of one number (DeviceOptions).
void fail_launches(bool fail, std::optional<std::size_t> number = std::nullopt);

// What the OpenCL runtime needs from the process before the first call into it.
// PoCL aborts without /proc and /sys and fails or crashes without a writable kernel cache folder: throws
// DeviceError naming what is missing and the remedy. Does nothing where PoCL is not installed.
void check_runtime_environment();

// That there is no device, with the remedy: a driver, or a variable that keeps one away.
std::string no_device();

}  // namespace teletact::service
