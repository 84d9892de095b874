#include "client/servo/ending.h"

#include <signal.h>
#include <time.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <mutex>
#include <string_view>

namespace teletact::client {
namespace {

struct Slot {
  std::atomic<LastAct::Act> act{nullptr};
  std::atomic<void*> of{nullptr};
};
std::array<Slot, 8> slots;
std::mutex slots_mutex;  // of who comes and goes; the handler takes none

std::atomic<bool> asked{false}, ending{false};
static_assert(std::atomic<bool>::is_always_lock_free && std::atomic<void*>::is_always_lock_free &&
                  std::atomic<LastAct::Act>::is_always_lock_free,
              "used by signal handlers");

constexpr std::array kOrderly = {SIGINT, SIGTERM, SIGHUP};
constexpr std::array kAtOnce = {SIGSEGV, SIGABRT, SIGBUS,  SIGFPE,  SIGILL,   SIGSYS,
                                SIGTRAP, SIGQUIT, SIGALRM, SIGUSR1, SIGUSR2,  SIGVTALRM,
                                SIGPROF, SIGXCPU, SIGPOLL, SIGPWR,  SIGSTKFLT};
constexpr std::array kIgnored = {SIGPIPE, SIGXFSZ, SIGTSTP, SIGTTIN, SIGTTOU};
std::array<struct sigaction, kAtOnce.size()> before;  // a sanitizer's, say, which reports

void do_last_acts() noexcept {
  for (const Slot& slot : slots)
    if (const LastAct::Act act = slot.act.load()) act(slot.of.load());
}

// As `signal` ends a process without us: a fault comes again when the handler returns, anything else is sent
// again.
void end_by(int signal, const siginfo_t* info) noexcept {
  struct sigaction action {};
  action.sa_handler = SIG_DFL;
  for (std::size_t k = 0; k < kAtOnce.size(); ++k)
    if (kAtOnce[k] == signal) action = before[k];
  sigaction(signal, &action, nullptr);
  const bool fault =
      signal == SIGSEGV || signal == SIGBUS || signal == SIGFPE || signal == SIGILL || signal == SIGTRAP;
  const bool caused_here = fault && info->si_code > 0 && info->si_code != SI_KERNEL;
  if (!caused_here) raise(signal);
}

// What every end that is not an orderly one does first. By one thread, to which no handler comes.
void end_without_force() noexcept {
  if (ending.exchange(true))
    while (true) pause();  // another thread is at it
  do_last_acts();
  // Once more: a write may have been under way. By now a device's own thread has taken it too.
  const timespec both_sides{0, 10'000'000};
  nanosleep(&both_sides, nullptr);
  do_last_acts();
}

void end_at_once(int signal, siginfo_t* info, void*) {
  end_without_force();
  end_by(signal, info);
}

void ask(int signal, siginfo_t* info, void* context) {
  const int error = errno;
  if (asked.exchange(true)) end_at_once(signal, info, context);
  errno = error;
}

struct sigaction handled_by(void (*handler)(int, siginfo_t*, void*)) {
  struct sigaction action {};
  action.sa_sigaction = handler;
  action.sa_flags = SA_SIGINFO | SA_ONSTACK;
  sigfillset(&action.sa_mask);
  return action;
}

void install() {
  const struct sigaction orderly = handled_by(ask), at_once = handled_by(end_at_once);
  for (const int signal : kOrderly) {
    struct sigaction old {};
    sigaction(signal, nullptr, &old);
    if (signal == SIGHUP && old.sa_handler == SIG_IGN) continue;  // nohup
    sigaction(signal, &orderly, nullptr);
  }
  for (std::size_t k = 0; k < kAtOnce.size(); ++k) sigaction(kAtOnce[k], &at_once, &before[k]);
  for (const int signal : kIgnored) ::signal(signal, SIG_IGN);
}

}  // namespace

const std::atomic<bool>& end_in_order() {
  static std::once_flag once;
  std::call_once(once, install);
  return asked;
}

void end_now(int code, std::string_view why) noexcept {
  sigset_t all;
  sigfillset(&all);
  pthread_sigmask(SIG_BLOCK, &all, nullptr);
  end_without_force();
  (void)!write(STDERR_FILENO, why.data(), why.size());
  _exit(code);
}

LastAct::LastAct(Act act, void* of) {
  const std::lock_guard lock(slots_mutex);
  for (std::size_t k = 0; k < slots.size() && slot_ < 0; ++k) {
    if (slots[k].act.load() != nullptr) continue;
    slots[k].of = of;
    slots[k].act = act;
    slot_ = static_cast<int>(k);
  }
}

LastAct::~LastAct() {
  const std::lock_guard lock(slots_mutex);
  if (slot_ >= 0) slots[static_cast<std::size_t>(slot_)].act = nullptr;
}

}  // namespace teletact::client
