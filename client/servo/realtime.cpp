#include "client/servo/realtime.h"

#include <linux/capability.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

namespace teletact::client {
namespace {

// CAP_IPC_LOCK: the limit does not hold for this process.
bool may_lock_anything() {
  __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
  std::array<__user_cap_data_struct, _LINUX_CAPABILITY_U32S_3> data{};
  if (syscall(SYS_capget, &header, data.data()) != 0) return false;
  return (data[CAP_TO_INDEX(CAP_IPC_LOCK)].effective & CAP_TO_MASK(CAP_IPC_LOCK)) != 0;
}

// From here down, as far as the loop's frames can reach.
bool lock_stack() {
  constexpr std::size_t kReachedBytes = 128 * 1024;
  pthread_attr_t attributes;
  void* low = nullptr;
  std::size_t bytes = 0;
  if (pthread_getattr_np(pthread_self(), &attributes) != 0) return false;
  pthread_attr_getstack(&attributes, &low, &bytes);
  pthread_attr_destroy(&attributes);
  const char here = 0;
  const auto below = static_cast<std::size_t>(&here - static_cast<char*>(low));
  const std::size_t locked = std::min(kReachedBytes, below);
  return mlock(&here - locked, locked) == 0;
}

}  // namespace

RealTime ask_for_real_time(const void* loop, std::size_t bytes) {
  RealTime granted;
  // Above ordinary threads, below the kernel's own interrupt threads (50).
  constexpr int kPriority = 40;
  sched_param parameters{};
  parameters.sched_priority = kPriority;
  const int fifo_error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters);
  granted.fifo = fifo_error == 0;
  rlimit limit{};
  const bool unlimited =
      may_lock_anything() || (getrlimit(RLIMIT_MEMLOCK, &limit) == 0 && limit.rlim_cur == RLIM_INFINITY);
  // On fault: what the loop touches stays; the unused stacks of other threads take no memory.
  granted.locked = unlimited ? mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0
                             : mlock(loop, bytes) == 0 && lock_stack();
  const int lock_error = granted.locked ? 0 : errno;
  granted.text = granted.fifo ? "SCHED_FIFO"
                              : std::string("no SCHED_FIFO (") + std::strerror(fifo_error) +
                                    "; allow it with 'ulimit -r 40' or CAP_SYS_NICE)";
  if (!granted.locked)
    granted.text += std::string(", memory not locked (") + std::strerror(lock_error) +
                    "; allow it with 'ulimit -l unlimited')";
  else if (unlimited)
    granted.text += ", memory locked";
  else
    granted.text += ", the loop's memory locked (all of it: 'ulimit -l unlimited')";
  return granted;
}

}  // namespace teletact::client
