// The one thread on which the imaging plane works: estimates, model builds, writing state. It runs at a
// raised nice value, so that touch, at normal priority, never waits for it (T1).
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <thread>
#include <type_traits>

namespace teletact::service {

enum class JobUrgency { kUrgent, kBackground };  // background waits until nothing urgent is left

class NicedWorker {
 public:
  static constexpr int kNiceness = 10;
  static constexpr std::size_t kMostUrgentJobs = 64;  // waiting; background jobs are one per scene

  NicedWorker();
  ~NicedWorker();
  NicedWorker(const NicedWorker&) = delete;
  NicedWorker& operator=(const NicedWorker&) = delete;

  // Waits for the job that runs and drops those that wait; later ones are dropped too.
  void stop();
  // Waits for every job posted so far, then stops.
  void finish();

  // Throws Error(kExhausted) when kMostUrgentJobs wait already. An exception of `job` is logged.
  void post(JobUrgency, std::function<void()> job);

  // Runs `work` as an urgent job; the future brings its value or exception, std::future_error when dropped.
  template <class Work>
  auto run(Work work) {
    using Result = std::invoke_result_t<Work>;
    auto task = std::make_shared<std::packaged_task<Result()>>(std::move(work));
    auto future = task->get_future();
    post(JobUrgency::kUrgent, [task] { (*task)(); });
    return future;
  }

 private:
  void work();
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<std::function<void()>> urgent_, background_;
  bool stop_ = false, finish_ = false;
  std::thread thread_;
};

}  // namespace teletact::service
