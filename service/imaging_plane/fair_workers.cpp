#include "service/imaging_plane/fair_workers.h"

#include <spdlog/spdlog.h>

#include <stdexcept>
#include <system_error>
#include <utility>

#include "service/base/current_trace.h"
#include "service/device/cancellation.h"
#include "service/scene/errors.h"
#include "service/scene/niced_worker.h"

namespace teletact::service {

namespace {

std::exception_ptr error_of(ErrorKind kind, const char* what) {
  return std::make_exception_ptr(Error(kind, what));
}
constexpr const char* kStopping = "the service is shutting down; connect again later";
constexpr const char* kLate =
    "not done within the time allowed; allow more, or ask again when fewer clients are served";

thread_local FairWorkers* works_for = nullptr;
thread_local FairWorkers::Id works_on = 0;

}  // namespace

FairWorkers::~FairWorkers() {
  stop();
}

void FairWorkers::stop() {
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

FairWorkers::Id FairWorkers::post(const JobTerms& terms, std::function<void()> work, Done done) {
  Lock lock(mutex_);
  if (stop_) throw Error(ErrorKind::kUnavailable, kStopping);
  const Id id = queue_.add(terms, Clock::now());
  auto job = std::make_shared<Job>();
  job->work = in_current_trace(std::move(work)), job->done = in_current_trace(std::move(done));
  job->deadline = terms.deadline;
  if (terms.owed) job->deadline = JobTerms::Time::max();  // late is better than never
  jobs_[id] = std::move(job);
  dispatch();
  return id;
}

void FairWorkers::cancel(Id id) {
  Lock lock(mutex_);
  const auto found = jobs_.find(id);
  if (found == jobs_.end()) return;
  found->second->cancelled = true;
  found->second->turn.notify_all();
  if (!found->second->has_thread) end(id, error_of(ErrorKind::kCancelled, "the caller cancelled"), lock);
}

FairWorkers::Id FairWorkers::current() const {
  if (works_for != this) throw std::logic_error("not on a thread of these workers");
  return works_on;
}

FairWorkers& FairWorkers::here() {
  if (!works_for) throw std::logic_error("not on a thread of the imaging plane");
  return *works_for;
}

double FairWorkers::done_in_s(const JobTerms& terms) const {
  const Lock lock(mutex_);
  return queue_.done_in_s(terms, Clock::now());
}

double FairWorkers::worked_s() const {
  const Lock lock(mutex_);
  const std::chrono::duration<double> going_on = running_ ? Clock::now() - since_ : Clock::duration{};
  return worked_s_ + going_on.count();
}

double FairWorkers::silent_s() const {
  const Lock lock(mutex_);
  return running_ ? std::chrono::duration<double>(Clock::now() - since_).count() : 0;
}

// Gives the turn to whose it is, when nobody has it.
void FairWorkers::dispatch() {
  if (running_ || stop_) return;
  const auto next = queue_.next(Clock::now());
  if (!next) return;
  Job& job = *jobs_.at(*next);
  if (!job.has_thread && idle_ == 0) try {
      threads_.emplace_back([this] { this->work(); });
    } catch (const std::system_error& error) {  // it waits for a thread that is done
      spdlog::error("event=thread_refused error=\"{}\"", error.what());
      return;
    }
  running_ = *next;
  since_ = Clock::now();
  if (job.has_thread) {
    job.turn.notify_all();
    return;
  }
  job.has_thread = true;
  queue_.begun(running_);
  starting_ = running_;
  start_.notify_one();
}

void FairWorkers::work() {
  be_nice();
  Lock lock(mutex_);
  for (;;) {
    ++idle_;
    start_.wait(lock, [this] { return stop_ || starting_; });
    --idle_;
    if (!starting_) return;
    const Id id = std::exchange(starting_, 0);
    const std::shared_ptr<Job> job = jobs_.at(id);
    work_on(id, *job, lock);
  }
}

void FairWorkers::work_on(Id id, Job& job, Lock& lock) {
  std::exception_ptr error;
  lock.unlock();
  works_for = this, works_on = id;
  try {
    const CancellationCheck check([this, id, &job] { look_up(id, job); });
    check_cancelled();
    job.work();
  } catch (...) {
    error = std::current_exception();
  }
  job.work = nullptr;
  works_for = nullptr, works_on = 0;
  lock.lock();
  if (running_ == id) charge(id);
  end(id, error, lock);
}

void FairWorkers::charge(Id id) {
  const auto now = Clock::now();
  const double s = std::chrono::duration<double>(now - since_).count();
  queue_.served(id, s, now);
  worked_s_ += s;
  since_ = now;
}

// Out of the queue, its place to another; `done` is told without the lock.
void FairWorkers::end(Id id, std::exception_ptr error, Lock& lock) {
  const auto found = jobs_.find(id);
  if (found == jobs_.end()) return;
  const std::shared_ptr<Job> job = std::move(found->second);
  jobs_.erase(found);
  queue_.ended(id, Clock::now());
  if (running_ == id) running_ = 0;
  dispatch();
  lock.unlock();
  job->work = nullptr;
  job->done(std::move(error));
  job->done = nullptr;
  lock.lock();
}

void FairWorkers::drop_expired(Lock& lock) {
  for (const Id id : queue_.expired(Clock::now())) end(id, error_of(ErrorKind::kDeadline, kLate), lock);
}

// Throws when the job is to end.
void FairWorkers::forbid(const Job& job) const {
  if (stop_) throw Error(ErrorKind::kUnavailable, kStopping);
  if (job.cancelled) throw Error(ErrorKind::kCancelled, "the caller cancelled");
  if (job.deadline <= Clock::now()) throw Error(ErrorKind::kDeadline, kLate);
}

void FairWorkers::look_up(Id id, Job& job) {
  Lock lock(mutex_);
  forbid(job);
  charge(id);
  drop_expired(lock);
  if (queue_.makes_way(id, Clock::now())) make_way(id, job, lock);
}

void FairWorkers::step_aside(Id other) {
  const Id id = current();
  Lock lock(mutex_);
  const std::shared_ptr<Job> job = jobs_.at(id);
  forbid(*job);
  charge(id);
  if (!jobs_.contains(other)) return;
  queue_.wait(id, other);
  make_way(id, *job, lock);
}

// Returns when it is this job's turn again; throws when it is to end.
void FairWorkers::make_way(Id id, Job& job, Lock& lock) {
  const auto begun = Clock::now();
  running_ = 0;
  dispatch();
  while (running_ != id && !stop_ && !job.cancelled) {
    job.turn.wait_for(lock, std::chrono::milliseconds(100));
    dispatch();  // nobody else may: there was no thread for whose turn it was
    if (job.deadline <= Clock::now()) break;
  }
  add_waited(std::chrono::duration<double>(Clock::now() - begun).count());
  forbid(job);
}

}  // namespace teletact::service
