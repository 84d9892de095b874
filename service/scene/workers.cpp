#include "service/scene/workers.h"

#include <spdlog/spdlog.h>
#include <sys/resource.h>
#include <unistd.h>

#include <optional>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "service/base/current_trace.h"
#include "service/device/cancellation.h"
#include "service/scene/errors.h"

namespace teletact::service {

namespace {

std::exception_ptr error_of(ErrorKind kind, const char* what) {
  return std::make_exception_ptr(Error(kind, what));
}
constexpr const char* kStopping = "the service is shutting down; connect again later";
constexpr const char* kLate =
    "not done within the time allowed; allow more, or ask again when fewer clients are served";

thread_local const Workers* works_for = nullptr;
thread_local Workers::Id works_on = 0;

double seconds_since(Workers::Clock::time_point begun) {
  return std::chrono::duration<double>(Workers::Clock::now() - begun).count();
}

}  // namespace

void be_nice() {
  constexpr int kNiceness = 10;
  // Linux gives each thread its own nice value.
  if (setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), kNiceness) != 0)
    spdlog::warn("event=niceness_refused errno={}", errno);
}

Workers::~Workers() {
  stop();
}

void Workers::stop() {
  std::list<std::thread> threads;
  {
    Lock lock(mutex_);
    stop_ = true;
    std::vector<Id> waiting;
    for (auto& [id, job] : jobs_) {
      job->cancelled = true;
      job->turn.notify_all();
      if (!job->has_thread) waiting.push_back(id);
    }
    for (const Id id : waiting) end(id, error_of(ErrorKind::kUnavailable, kStopping), lock);
    threads.swap(threads_);
  }
  start_.notify_all();
  for (std::thread& thread : threads) thread.join();
}

void Workers::finish() {
  {
    Lock lock(mutex_);
    while (!ended_.wait_for(lock, std::chrono::milliseconds(100), [this] { return jobs_.empty(); }))
      dispatch();  // there was no thread for whose turn it was
  }
  stop();
}

Workers::Id Workers::post(const JobTerms& terms, std::function<void()> work, Done done) {
  Lock lock(mutex_);
  if (stop_) throw Error(ErrorKind::kUnavailable, kStopping);
  const Id id = schedule_.add(terms, Clock::now());
  auto job = std::make_shared<Job>();
  job->terms = terms;
  job->work = in_current_trace(std::move(work)), job->done = in_current_trace(std::move(done));
  if (terms.owed) job->terms.deadline = JobTerms::Time::max();  // late is better than never
  jobs_[id] = std::move(job);
  turns_[terms.device];
  dispatch();
  return id;
}

Workers::Id Workers::post(std::function<void()> work, const std::string& client) try {
  auto logged = [work = std::move(work)] {
    try {
      work();
    } catch (const std::exception& error) {
      spdlog::error("event=job_failed error=\"{}\"", error.what());
    }
  };
  return post({.client = client, .background = true}, std::move(logged), [](const std::exception_ptr&) {});
} catch (const Error&) {  // stopped
  return 0;
}

void Workers::cancel(Id id) {
  Lock lock(mutex_);
  const auto found = jobs_.find(id);
  if (found == jobs_.end()) return;
  found->second->cancelled = true;
  found->second->turn.notify_all();
  if (!found->second->has_thread) end(id, error_of(ErrorKind::kCancelled, "the caller cancelled"), lock);
}

std::size_t Workers::device_here() const {
  if (works_for != this) throw std::logic_error("not on a thread of these workers");
  const Lock lock(mutex_);
  return jobs_.at(works_on)->terms.device;
}

bool Workers::do_alone(const void* what, Clock::duration patience, const std::function<void()>& work) {
  device_here();
  const Id id = works_on;
  const auto until = Clock::now() + patience;
  Lock lock(mutex_);
  const std::shared_ptr<Job> job = jobs_.at(id);
  forbid(*job);
  charge(id, *job);
  const std::shared_ptr<void> given_back(nullptr, [&](void*) {
    if (!lock) lock.lock();
    schedule_.give_back(id);
    dispatch();
  });
  while (!schedule_.take(id, what))
    if (!make_way(id, *job, until, lock)) return false;
  lock.unlock();
  work();
  return true;
}

double Workers::done_in_s(const JobTerms& terms) const {
  const Lock lock(mutex_);
  return schedule_.done_in_s(terms, Clock::now());
}

double Workers::worked_s(std::size_t device) const {
  const Lock lock(mutex_);
  const auto turn = turns_.find(device);
  if (turn == turns_.end()) return 0;
  return turn->second.worked_s + (turn->second.running ? seconds_since(turn->second.since) : 0);
}

double Workers::silent_s(std::size_t device) const {
  const Lock lock(mutex_);
  const auto turn = turns_.find(device);
  return turn == turns_.end() || !turn->second.running ? 0 : seconds_since(turn->second.since);
}

// Gives each device's turn to whose it is, where nobody has it.
void Workers::dispatch() {
  for (auto& [device, turn] : turns_)
    if (!turn.running && !stop_) dispatch(device, turn);
}

void Workers::dispatch(std::size_t device, Turn& turn) {
  const auto next = schedule_.next(device, Clock::now());
  if (!next) return;
  Job& job = *jobs_.at(*next);
  if (!job.has_thread && idle_ <= starting_.size()) try {
      threads_.emplace_back([this] { this->work(); });
    } catch (const std::system_error& error) {  // it waits for a thread that is done
      spdlog::error("event=thread_refused error=\"{}\"", error.what());
      return;
    }
  turn.running = *next;
  turn.since = Clock::now();
  if (job.has_thread) return job.turn.notify_all();
  job.has_thread = true;
  schedule_.begun(*next);
  starting_.insert(*next);
  start_.notify_one();
}

void Workers::work() {
  be_nice();
  Lock lock(mutex_);
  for (;;) {
    ++idle_;
    dispatch();
    start_.wait(lock, [this] { return stop_ || !starting_.empty(); });
    --idle_;
    if (starting_.empty()) return;
    const Id id = starting_.extract(starting_.begin()).value();
    const std::shared_ptr<Job> job = jobs_.at(id);
    work_on(id, *job, lock);
  }
}

void Workers::work_on(Id id, Job& job, Lock& lock) {
  std::exception_ptr error;
  try {
    forbid(job);
    lock.unlock();
    works_for = this, works_on = id;
    std::optional<CancellationCheck> check;
    if (!job.terms.background) check.emplace([this, id, &job] { look_up(id, job); });
    job.work();
  } catch (...) {
    error = std::current_exception();
  }
  if (lock) lock.unlock();
  job.work = nullptr;
  works_for = nullptr, works_on = 0;
  lock.lock();
  if (turns_.at(job.terms.device).running == id) charge(id, job);
  end(id, error, lock);
}

void Workers::charge(Id id, const Job& job) {
  Turn& turn = turns_.at(job.terms.device);
  const auto now = Clock::now();
  const double s = std::chrono::duration<double>(now - turn.since).count();
  schedule_.served(id, s, now);
  turn.worked_s += s;
  turn.since = now;
}

// Out of the schedule, its place to another; `done` is told without the lock.
void Workers::end(Id id, std::exception_ptr error, Lock& lock) {
  const auto found = jobs_.find(id);
  if (found == jobs_.end()) return;
  const std::shared_ptr<Job> job = std::move(found->second);
  jobs_.erase(found);
  schedule_.ended(id, Clock::now());
  Turn& turn = turns_.at(job->terms.device);
  const bool background = job->terms.background;  // the next begins on this thread: one is enough
  if (turn.running == id && !background) turn.running = 0;
  dispatch();
  lock.unlock();
  job->work = nullptr;
  job->done(std::move(error));
  job->done = nullptr;
  lock.lock();
  if (turn.running == id) turn.running = 0;
  if (jobs_.empty()) ended_.notify_all();
}

void Workers::drop_expired(Lock& lock) {
  for (const Id id : schedule_.expired(Clock::now())) {
    // end() unlocks: another device's thread may have begun it meanwhile, or ended it.
    const auto job = jobs_.find(id);
    if (job != jobs_.end() && !job->second->has_thread) end(id, error_of(ErrorKind::kDeadline, kLate), lock);
  }
}

// Throws when the job is to end.
void Workers::forbid(const Job& job) const {
  if (stop_) throw Error(ErrorKind::kUnavailable, kStopping);
  if (job.cancelled) throw Error(ErrorKind::kCancelled, "the caller cancelled");
  if (job.terms.deadline <= Clock::now()) throw Error(ErrorKind::kDeadline, kLate);
}

void Workers::look_up(Id id, Job& job) {
  Lock lock(mutex_);
  forbid(job);
  charge(id, job);
  drop_expired(lock);
  if (schedule_.makes_way(id, Clock::now())) make_way(id, job, JobTerms::Time::max(), lock);
}

// Returns when it is this job's turn again, or, false, when it still waits for another device's job by
// `until`. Throws when it is to end.
bool Workers::make_way(Id id, Job& job, JobTerms::Time until, Lock& lock) {
  const auto begun = Clock::now();
  Turn& turn = turns_.at(job.terms.device);
  const auto gives_up = [&] { return until <= Clock::now() && schedule_.waits_elsewhere(id); };
  turn.running = 0;
  dispatch();
  while (turn.running != id && !stop_ && !job.cancelled && !gives_up()) {
    job.turn.wait_for(lock, std::chrono::milliseconds(100));
    dispatch();  // nobody else may: there was no thread for whose turn it was
    if (job.terms.deadline <= Clock::now()) break;
  }
  add_waited(seconds_since(begun));
  forbid(job);
  return turn.running == id;
}

}  // namespace teletact::service
