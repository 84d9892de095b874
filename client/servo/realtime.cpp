#include "client/servo/realtime.h"

#include <sched.h>
#include <sys/mman.h>

#include <cerrno>
#include <cstring>

namespace teletact::client {

int ask_for_fifo(int priority) noexcept {
  sched_param parameters{};
  parameters.sched_priority = priority;
  // For this thread alone: gRPC starts helpers of its own from the threads that call it.
  return sched_setscheduler(0, SCHED_FIFO | SCHED_RESET_ON_FORK, &parameters) == 0 ? 0 : errno;
}

RealTime ask_for_real_time() {
  RealTime granted;
  const int fifo_error = ask_for_fifo(kServoPriority);
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
