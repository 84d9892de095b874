#include "service/rpc/free_memory.h"

#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <condition_variable>
#include <fstream>
#include <mutex>

#include "service/scene/workers.h"

namespace teletact::service {

std::size_t resident_bytes_now() {
  std::size_t size = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> size >> resident;
  return resident * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
}

namespace {

std::size_t unused_bytes(std::size_t used) {
  const std::size_t resident = resident_bytes_now();
  return resident - std::min(resident, used);
}

}  // namespace

FreeMemory::FreeMemory(std::chrono::milliseconds between)
    : thread_([this, between](const std::stop_token& stop) {
        be_nice();
        std::mutex mutex;
        std::unique_lock lock(mutex);
        std::condition_variable_any stopped;
        while (!stopped.wait_for(lock, stop, between, [&] { return stop.stop_requested(); })) look();
      }) {}

// What was given back still counts as free: whether there is more, memory says that is resident and that no
// block is in. By resident memory alone, nothing would be given back that was in use when this looked last.
void FreeMemory::look() {
  const auto heap = ::mallinfo2();
  const std::size_t used = heap.uordblks + heap.hblkhd;
  unused_bytes_ = std::min(unused_bytes_, unused_bytes(used));
  if (heap.fordblks < kMinBytes || unused_bytes(used) < unused_bytes_ + kMinBytes) return;
  ::malloc_trim(0);
  unused_bytes_ = unused_bytes(used);  // of then: what was freed meanwhile is still to be given back
}

}  // namespace teletact::service
