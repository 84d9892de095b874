#include "service/scene/niced_worker.h"

#include <spdlog/spdlog.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <utility>

#include "service/base/current_trace.h"

namespace teletact::service {

void be_nice() {
  constexpr int kNiceness = 10;
  // Linux gives each thread its own nice value.
  if (setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), kNiceness) != 0)
    spdlog::warn("event=niceness_refused errno={}", errno);
}

NicedWorker::NicedWorker() : thread_([this] { work(); }) {}

NicedWorker::~NicedWorker() {
  stop();
}

void NicedWorker::stop() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
  decltype(jobs_) dropped;  // destroyed without the lock: whoever waits for one may want to drop it
  const std::lock_guard lock(mutex_);
  dropped.swap(jobs_);
}

void NicedWorker::finish() {
  {
    const std::lock_guard lock(mutex_);
    finish_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
  stop();
}

NicedWorker::Id NicedWorker::post(std::function<void()> job, const std::string& of) {
  Id id = 0;
  {
    const std::lock_guard lock(mutex_);
    id = ++posted_;
    if (stop_) return id;
    jobs_[of].push_back({id, in_current_trace(std::move(job))});
  }
  changed_.notify_one();
  return id;
}

void NicedWorker::drop(Id id) {
  std::function<void()> dropped;  // destroyed without the lock
  const std::lock_guard lock(mutex_);
  for (auto at = jobs_.begin(); at != jobs_.end(); ++at) {
    auto& [of, jobs] = *at;
    const auto job = std::find_if(jobs.begin(), jobs.end(), [id](const Job& one) { return one.id == id; });
    if (job == jobs.end()) continue;
    dropped = std::move(job->work);
    jobs.erase(job);
    if (jobs.empty()) jobs_.erase(at);
    return;
  }
}

// The first of whoever comes after him whose turn it was.
std::function<void()> NicedWorker::take() {
  auto next = jobs_.upper_bound(last_);
  if (next == jobs_.end()) next = jobs_.begin();
  last_ = next->first;
  std::function<void()> job = std::move(next->second.front().work);
  next->second.pop_front();
  if (next->second.empty()) jobs_.erase(next);
  return job;
}

void NicedWorker::work() {
  be_nice();
  for (;;) {
    std::function<void()> job;
    {
      std::unique_lock lock(mutex_);
      changed_.wait(lock, [this] { return stop_ || finish_ || !jobs_.empty(); });
      if (stop_ || jobs_.empty()) return;
      job = take();
    }
    try {
      job();
    } catch (const std::exception& error) {
      spdlog::error("event=job_failed error=\"{}\"", error.what());
    }
  }
}

}  // namespace teletact::service
