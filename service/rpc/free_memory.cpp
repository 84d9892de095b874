#include "service/rpc/free_memory.h"

#include <malloc.h>
#include <unistd.h>

#include <condition_variable>
#include <fstream>
#include <mutex>

#include "service/scene/niced_worker.h"

namespace teletact::service {

std::size_t resident_bytes_now() {
  std::size_t size = 0, resident = 0;
  std::ifstream("/proc/self/statm") >> size >> resident;
  return resident * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
}

FreeMemory::FreeMemory(std::chrono::milliseconds between)
    : thread_([this, between](const std::stop_token& stop) {
        be_nice();
        std::mutex mutex;
        std::unique_lock lock(mutex);
        std::condition_variable_any stopped;
        while (!stopped.wait_for(lock, stop, between, [&] { return stop.stop_requested(); })) look();
      }) {}

// What was given back still counts as free: whether there is more, resident memory says.
void FreeMemory::look() {
  if (resident_bytes_now() < resident_bytes_ + kLeastBytes || ::mallinfo2().fordblks < kLeastBytes) return;
  ::malloc_trim(0);
  resident_bytes_ = resident_bytes_now();
}

}  // namespace teletact::service
