#include "client/servo/realtime.h"

#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>

#include <cerrno>
#include <cstring>

namespace teletact::client {

RealTime ask_for_real_time() {
  RealTime granted;
  // Above ordinary threads, below the kernel's own interrupt threads (50).
  constexpr int kPriority = 40;
  sched_param parameters{};
  parameters.sched_priority = kPriority;
  const int fifo_error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameters);
  granted.fifo = fifo_error == 0;
  // On fault: what the loop touches stays; the unused stacks of other threads take no memory.
  granted.locked = mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT) == 0;
  const int lock_error = granted.locked ? 0 : errno;
  granted.text = granted.fifo ? "SCHED_FIFO"
                              : std::string("no SCHED_FIFO (") + std::strerror(fifo_error) +
                                    "; allow it with 'ulimit -r 40' or CAP_SYS_NICE)";
  granted.text += granted.locked ? ", memory locked"
                                 : std::string(", memory not locked (") + std::strerror(lock_error) +
                                       "; allow it with 'ulimit -l unlimited')";
  return granted;
}

}  // namespace teletact::client
