// Buffers, copies, launches and their profile.
#include "service/device/queue.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "service/device/cancellation.h"
#include "service/device/device.h"

namespace teletact::service {
namespace {

// Launches kept before the profile is summed up.
constexpr std::size_t kPendingLaunches = 4096;

// Kept at most of what is on its way to the device; a larger write waits.
constexpr std::size_t kMaxSentBytes = std::size_t{8} << 20;

// On a thread that looks up: of work that a queue may have ahead, and bytes that are moved at once.
constexpr double kAheadS = 0.01;
constexpr std::size_t kBytesAtOnce = std::size_t{8} << 20;
// Of a launch of a size that has not been measured, the first slice.
constexpr std::size_t kItemsToTry = 4096;
// PoCL compiles a kernel apart for wider launches, and apart again for those that start within their range.
constexpr std::size_t kWidestSlice = 65535;
constexpr double kMaxGrowth = 4;       // of one slice to the next
constexpr std::size_t kMaxSizes = 64;  // that are remembered for a kernel
constexpr int kMeasured = 3;           // launches of a size, after which it is known

std::atomic<std::uint64_t> failing{0};  // a bit for each device, by its number

void check_range(const RawBuffer& buffer, std::size_t bytes, std::size_t offset) {
  if (offset > buffer.bytes || bytes > buffer.bytes - offset)
    throw DeviceError("copy of " + std::to_string(bytes) + " bytes at " + std::to_string(offset) +
                      " exceeds a buffer of " + std::to_string(buffer.bytes));
}

}  // namespace

void fail_launches(bool fail, std::optional<std::size_t> number) {
  const std::uint64_t bits = number ? std::uint64_t{1} << *number : ~std::uint64_t{0};
  fail ? failing |= bits : failing &= ~bits;
}

void LaunchLog::collect() {
  for (auto& [name, event] : pending) {
    event.wait();
    KernelTime& total = totals[name];
    total.name = name;
    ++total.launches;
    total.seconds += 1e-9 * static_cast<double>(event.getProfilingInfo<CL_PROFILING_COMMAND_END>() -
                                                event.getProfilingInfo<CL_PROFILING_COMMAND_START>());
  }
  pending.clear();
}

void Kernel::set_buffer(unsigned index, const RawBuffer* buffer) {
  if (!raw_) throw DeviceError("launch of a kernel that was never built");
  if (!buffer)
    throw DeviceError("argument " + std::to_string(index) + " of kernel " + raw_->name + " is not an array");
  guarded("argument " + std::to_string(index) + " of kernel " + raw_->name,
          [&] { raw_->kernel.setArg(index, buffer->buffer); });
}

void Kernel::set_bytes(unsigned index, const void* data, std::size_t bytes) {
  if (!raw_) throw DeviceError("launch of a kernel that was never built");
  guarded("argument " + std::to_string(index) + " of kernel " + raw_->name,
          [&] { raw_->kernel.setArg(index, bytes, data); });
}

void Kernel::launch(const Range& range) {
  if (!raw_) throw DeviceError("launch of a kernel that was never built");
  if (range.global[0] == 0) return;
  raw_->work->chained += range.chain;
  raw_->work->longest_chain = std::max<std::uint64_t>(raw_->work->longest_chain, range.chain);
  std::array<std::size_t, 3> global{}, local{};
  for (std::size_t d = 0; d < 3; ++d) {
    local[d] = std::max<std::size_t>(1, range.local[d]);
    global[d] = (std::max<std::size_t>(1, range.global[d]) + local[d] - 1) / local[d] * local[d];
  }
  if (is_cancellable())
    raw_->launch_at_pace(global, local);
  else
    raw_->enqueue({}, global, local);
}

void RawKernel::enqueue(const Sizes& from, const Sizes& global, const Sizes& local) {
  if (!std::exchange(used_before, true)) count_compile_step();
  ++work->launches;
  guarded("launch of kernel " + name, [&] {
    cl::Event event;
    if (failing >> device & 1) throw cl::Error(CL_DEVICE_NOT_AVAILABLE, "clEnqueueNDRangeKernel");
    const bool whole = from == Sizes{};
    queue.enqueueNDRangeKernel(kernel, whole ? cl::NullRange : cl::NDRange(from[0], from[1], from[2]),
                               cl::NDRange(global[0], global[1], global[2]),
                               cl::NDRange(local[0], local[1], local[2]), nullptr,
                               log->enabled ? &event : nullptr);
    if (!log->enabled) return;
    log->pending.emplace_back(name, event);
    if (log->pending.size() >= kPendingLaunches) log->collect();
  });
}

void RawKernel::finish() {
  guarded("waiting for the device", [&] { queue.finish(); });
  ++work->waits;
}

void RawKernel::catch_up() {
  finish();
  pace->ahead_s = 0;
  check_cancelled();
}

RawKernel::Cut RawKernel::cut(const Sizes& global, const Sizes& local) {
  Cut cut;
  for (std::size_t d = 1; d < 3; ++d)
    if (global[d] / local[d] > global[cut.along] / local[cut.along]) cut.along = d;
  cut.groups = global[cut.along] / local[cut.along];
  cut.max = of_pocl ? std::clamp<std::size_t>(kWidestSlice / local[cut.along], 1, cut.groups) : cut.groups;
  if (of_pocl && !cut_before &&
      cut.groups > 1) {  // the two that PoCL compiles: at a warm-up, not within an estimate
    cut.max = std::min(cut.max, (cut.groups + 1) / 2);
    cut_before = true;
  }
  return cut;
}

void RawKernel::enqueue(const Cut& cut, std::size_t first, std::size_t count, const Sizes& global,
                        const Sizes& local) {
  Sizes from{}, size = global;
  from[cut.along] = first * local[cut.along];
  size[cut.along] = count * local[cut.along];
  enqueue(from, size, local);
}

// Work-items know nothing of their launch but where they are in it, so that a launch may come in slices.
void RawKernel::launch_at_pace(const Sizes& global, const Sizes& local) {
  if (measured.size() > kMaxSizes) measured.clear();
  Measured& launch = measured[global];
  const Cut cut = this->cut(global, local);
  const bool known = launch.launches >= kMeasured;
  if (known && launch.s <= kAheadS) {
    if (pace->ahead_s + launch.s > kAheadS) catch_up();
    for (std::size_t done = 0; done < cut.groups; done += cut.max)
      enqueue(cut, done, std::min(cut.max, cut.groups - done), global, local);
    pace->ahead_s += launch.s;
    return;
  }
  if (pace->ahead_s > 0) catch_up();
  const std::size_t items = global[0] * global[1] * global[2];
  const double part = known ? kAheadS / launch.s : double(kItemsToTry) / double(items);
  double step = part * double(cut.groups), took_s = 0;
  for (std::size_t done = 0; done < cut.groups;) {
    const std::size_t count =
        std::min(static_cast<std::size_t>(std::clamp(step, 1.0, double(cut.max))), cut.groups - done);
    const auto slice_begun = std::chrono::steady_clock::now();
    enqueue(cut, done, count, global, local);
    finish();
    const std::chrono::duration<double> slice = std::chrono::steady_clock::now() - slice_begun;
    took_s += slice.count();
    done += count;
    step = std::min(kAheadS / std::max(slice.count(), 1e-6), kMaxGrowth) * double(count);
    check_cancelled();
  }
  // The longest, since arguments of one size may ask for more work than others; but not the first.
  if (++launch.launches > 1) launch.s = known ? took_s : std::max(launch.s, took_s);
}

Queue::State::State(std::shared_ptr<Context> shared)
    : context(std::move(shared)), log(std::make_shared<LaunchLog>()) {
  log->enabled = context->options().profiling;
  queue = guarded("creating a queue on " + context->info().name, [&] {
    return cl::CommandQueue(context->cl(), context->device(),
                            log->enabled ? cl::QueueProperties::Profiling : cl::QueueProperties::None);
  });
}

Queue::State::~State() {
  if (!sent.empty()) try {
      queue.finish();
    } catch (const cl::Error&) {  // a lost device: nothing is on its way any more
    }
}

void Queue::State::arrived() {
  ++work->waits;
  sent.clear();
  sent_bytes = 0;
  pace->ahead_s = 0;
  check_cancelled();
}

void Queue::State::in_pieces(std::size_t bytes,
                             const std::function<void(std::size_t first, std::size_t count)>& move) {
  const std::size_t most = is_cancellable() ? kBytesAtOnce : bytes;
  for (std::size_t first = 0; first < bytes; first += most) move(first, std::min(most, bytes - first));
}

Kernel Queue::kernel(std::string_view source, std::string_view name, Precision precision,
                     const Defines& defines) const {
  Kernel kernel;
  kernel.raw_ = std::make_shared<RawKernel>();
  kernel.raw_->kernel = state_->context->kernel(std::string(source), std::string(name), precision, defines);
  kernel.raw_->queue = state_->queue;
  kernel.raw_->log = state_->log;
  kernel.raw_->pace = state_->pace;
  kernel.raw_->work = state_->work;
  kernel.raw_->of_pocl = state_->context->info().platform == kPocl;
  kernel.raw_->name = name;
  kernel.raw_->device = state_->context->options().number;
  return kernel;
}

std::shared_ptr<RawBuffer> Queue::allocate(std::size_t bytes, const void* host) const {
  const DeviceInfo& info = state_->context->info();
  if (bytes > info.max_allocation_bytes)
    throw DeviceMemoryError("an array of " + std::to_string(bytes) + " bytes exceeds the " +
                            std::to_string(info.max_allocation_bytes) + " that " + info.name +
                            " can hold in one");
  auto raw = std::make_shared<RawBuffer>();
  raw->charge = state_->account.charge(place(), "arrays", bytes);
  raw->buffer = guarded("allocating " + std::to_string(bytes) + " bytes on " + info.name, [&] {
    if (!host || bytes == 0)
      return cl::Buffer(state_->context->cl(), CL_MEM_READ_WRITE, std::max<std::size_t>(bytes, 1));
    return cl::Buffer(state_->context->cl(), CL_MEM_READ_WRITE | CL_MEM_COPY_HOST_PTR, bytes,
                      const_cast<void*>(host));
  });
  if (host && bytes > 0) ++state_->work->waits, state_->work->bytes_to += bytes;
  raw->bytes = bytes;
  raw->held = state_->context->held_bytes();
  *raw->held += bytes;
  return raw;
}

void Queue::write_bytes(RawBuffer& buffer, const void* host, std::size_t bytes, std::size_t offset) const {
  check_range(buffer, bytes, offset);
  if (bytes == 0) return;
  const auto* from = static_cast<const std::byte*>(host);
  state_->work->bytes_to += bytes;
  state_->in_pieces(bytes, [&](std::size_t first, std::size_t count) {
    guarded("writing to the device", [&] {
      state_->queue.enqueueWriteBuffer(buffer.buffer, CL_TRUE, offset + first, count, from + first);
    });
    state_->arrived();
  });
}

void Queue::send_bytes(RawBuffer& buffer, std::shared_ptr<const void> held, const void* host,
                       std::size_t bytes, std::size_t offset) const {
  if (state_->sent_bytes + bytes > kMaxSentBytes) return write_bytes(buffer, host, bytes, offset);
  check_range(buffer, bytes, offset);
  if (bytes == 0) return;
  state_->sent.push_back(std::move(held));
  state_->sent_bytes += bytes;
  state_->work->bytes_to += bytes;
  ++state_->work->copies;
  guarded("writing to the device",
          [&] { state_->queue.enqueueWriteBuffer(buffer.buffer, CL_FALSE, offset, bytes, host); });
}

void Queue::read_bytes(const RawBuffer& buffer, void* host, std::size_t bytes, std::size_t offset) const {
  check_range(buffer, bytes, offset);
  if (bytes == 0) return;
  auto* to = static_cast<std::byte*>(host);
  state_->work->bytes_from += bytes;
  state_->in_pieces(bytes, [&](std::size_t first, std::size_t count) {
    guarded("reading from the device", [&] {
      state_->queue.enqueueReadBuffer(buffer.buffer, CL_TRUE, offset + first, count, to + first);
    });
    state_->arrived();
  });
}

Arrival Queue::fetch_bytes(const RawBuffer& buffer, void* host, std::size_t bytes) const {
  check_range(buffer, bytes, 0);
  Arrival arrival;
  if (bytes == 0) return arrival;
  auto raw = std::make_shared<RawRead>();
  guarded("reading from the device", [&] {
    state_->queue.enqueueReadBuffer(buffer.buffer, CL_FALSE, 0, bytes, host, nullptr, &raw->event);
    state_->queue.flush();
  });
  raw->work = state_->work;
  state_->work->bytes_from += bytes;
  ++state_->work->copies;
  arrival.raw_ = std::move(raw);
  return arrival;
}

RawRead::~RawRead() {
  if (event()) try {
      event.wait();
    } catch (const cl::Error&) {  // a lost device writes nothing any more
    }
}

void Arrival::wait() {
  if (!raw_) return;
  guarded("reading from the device", [&] { raw_->event.wait(); });
  ++raw_->work->looks;
  raw_.reset();
  check_cancelled();
}

void Queue::copy_bytes(const RawBuffer& from, RawBuffer& to, std::size_t bytes) const {
  check_range(from, bytes, 0);
  check_range(to, bytes, 0);
  if (bytes == 0) return;
  ++state_->work->copies;
  guarded("copying on the device",
          [&] { state_->queue.enqueueCopyBuffer(from.buffer, to.buffer, 0, 0, bytes); });
}

void Queue::zero_bytes(RawBuffer& buffer, std::size_t bytes) const {
  if (bytes == 0) return;
  state_->in_pieces(bytes, [&](std::size_t first, std::size_t count) {
    ++state_->work->copies;
    guarded("filling on the device", [&] {
      if (count % 4 == 0)
        state_->queue.enqueueFillBuffer(buffer.buffer, cl_uint{0}, first, count);
      else
        state_->queue.enqueueFillBuffer(buffer.buffer, cl_uchar{0}, first, count);
    });
    if (count < bytes) finish();
  });
}

void Queue::finish() const {
  guarded("waiting for the device", [&] { state_->queue.finish(); });
  state_->arrived();
}

std::vector<KernelTime> Queue::profile() const {
  guarded("profiling", [&] { state_->log->collect(); });
  std::vector<KernelTime> times;
  for (const auto& [name, time] : state_->log->totals) times.push_back(time);
  return times;
}

DeviceWork Queue::take_work() const {
  return std::exchange(*state_->work, DeviceWork{});
}

const DeviceInfo& Queue::info() const {
  return state_->context->info();
}

Place Queue::place() const {
  return place_of_device(state_->context->options().number);
}

void Queue::charge_to(const MemoryAccount& account) const {
  state_->account = account;
}

const MemoryAccount& Queue::account() const {
  return state_->account;
}

bool Queue::supports(Precision precision) const {
  return precision == Precision::kFloat || info().has_double;
}

}  // namespace teletact::service
