// How a process that may hold a force ends. INT, TERM and HUP (a closed terminal) ask for an orderly end: the
// loops see it, slew the force to zero and close the device. A second of them, a crash (SEGV, ABRT and so
// std::terminate, BUS, FPE, ...) and every other signal that ends a process do the last acts first, what the
// open devices and the terminal ask for, and then let it end as it would have.
//
// A thread that waits for ever in an adapter cannot be joined: end_now() ends the process without it.
//
// Signals that would stop the process with force on (Ctrl-Z, reading a terminal from the background) and
// those about a reader that is gone or a file that is too large (a write fails instead) are ignored.
#pragma once

#include <atomic>
#include <string_view>

namespace teletact::client {

// From now on, for the rest of the process. What is returned becomes true when it shall end.
const std::atomic<bool>& end_in_order();

// Does the last acts, writes `why` to stderr and ends the process with `code`. Nothing is destroyed, nothing
// buffered is written.
[[noreturn]] void end_now(int code, std::string_view why) noexcept;

// Done before the process ends at once, for as long as this lives: at most eight at a time, more are not
// done. `act` must be async-signal-safe, and bear being called twice and beside every other thread.
class LastAct {
 public:
  using Act = void (*)(void* of) noexcept;
  LastAct(Act act, void* of);
  ~LastAct();
  LastAct(const LastAct&) = delete;
  LastAct& operator=(const LastAct&) = delete;

 private:
  int slot_ = -1;
};

}  // namespace teletact::client
