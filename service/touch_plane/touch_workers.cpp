#include "service/touch_plane/touch_workers.h"

#include <sys/resource.h>

#include <algorithm>

namespace teletact::service {

namespace {

constexpr std::size_t kFewest = 2;  // one is kept from turns that are long

std::size_t workers_of(const Limits& limits) {
  return std::max(kFewest, static_cast<std::size_t>(limits.touch_workers));
}

// What this thread did since. Where it waited for something, a device for one, all the time that passed is
// its own; else what it had of a core is: the rest went to the machine's other work.
class OwnTime {
 public:
  TouchQueue::Clock::duration passed() const {
    const rusage now = usage();
    if (now.ru_nvcsw != begun_.ru_nvcsw) return TouchQueue::Clock::duration::max();
    return had(now) - had(begun_);
  }

 private:
  static rusage usage() {
    rusage out{};
    getrusage(RUSAGE_THREAD, &out);
    return out;
  }
  static std::chrono::microseconds had(const rusage& of) {
    return std::chrono::seconds(of.ru_utime.tv_sec + of.ru_stime.tv_sec) +
           std::chrono::microseconds(of.ru_utime.tv_usec + of.ru_stime.tv_usec);
  }
  const rusage begun_ = usage();
};

}  // namespace

TouchWorkers::TouchWorkers(const Limits& limits)
    : queue_({workers_of(limits), limits.min_touch_rate_hz}, Clock::now()) {
  for (std::size_t k = workers_of(limits); k > 0; --k) threads_.emplace_back([this] { work(); });
}

TouchWorkers::~TouchWorkers() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  changed_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

std::optional<std::string> TouchWorkers::overload(const TouchQueue::Principal& principal,
                                                  TouchQueue::TurnKind kind) {
  const std::lock_guard lock(mutex_);
  return queue_.overload(principal, kind, Clock::now());
}

TouchWorkers::Id TouchWorkers::join(const TouchQueue::Principal& principal, Clock::duration period,
                                    TouchTurns& turns) {
  const std::lock_guard lock(mutex_);
  const Id id = queue_.join(principal, period);
  turns_[id] = &turns;
  return id;
}

void TouchWorkers::wake(Id id, Clock::time_point due) {
  const auto now = Clock::now();
  const std::lock_guard lock(mutex_);
  queue_.wake(id, due, now);
  if (idle_ > 0 && (queue_.any_ready() || queue_.next_due() < watched_)) changed_.notify_one();
}

void TouchWorkers::work() {
  Lock lock(mutex_);
  while (!stop_)
    if (const auto turn = queue_.begin(Clock::now()))
      take_turn(*turn, lock);
    else
      wait(lock);
}

void TouchWorkers::wait(Lock& lock) {
  ++idle_;
  const auto due = queue_.next_due();
  if (due < watched_) {
    watched_ = due;
    changed_.wait_until(lock, due);
    if (watched_ == due) watched_ = Clock::time_point::max();
  } else {
    changed_.wait(lock);
  }
  --idle_;
}

void TouchWorkers::take_turn(const TouchQueue::Turn& turn, Lock& lock) {
  TouchTurns& turns = *turns_.at(turn.id);
  // Who watched what is due next has work; another one does both.
  if (idle_ > 0 && (queue_.any_ready() || queue_.next_due() < watched_)) changed_.notify_one();
  lock.unlock();
  const OwnTime own;
  const TouchTurns::Done done = turns.turn(turn.period);
  const auto passed = own.passed();
  lock.lock();
  queue_.done(turn.id, Clock::now(), done.next, done.answered, passed);
  if (!done.left) return;
  queue_.leave(turn.id);
  turns_.erase(turn.id);
  lock.unlock();
  turns.left();
  lock.lock();
}

}  // namespace teletact::service
