// The threads on which the imaging plane works with one device: estimates, model builds, what is owed. One
// works at a time, and gives way at a check_cancelled() (service/device/cancellation.h) when FairQueue says so; a job that gave
// way keeps its thread and goes on later. They run at a raised nice value, so that touch, at normal priority,
// never waits for them (T1).
#pragma once

#include <condition_variable>
#include <exception>
#include <functional>
#include <future>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <thread>
#include <type_traits>

#include "service/imaging_plane/fair_queue.h"

namespace teletact::service {

class FairWorkers {
 public:
  using Clock = std::chrono::steady_clock;
  using Id = FairQueue::Id;

  FairWorkers() = default;
  ~FairWorkers();
  FairWorkers(const FairWorkers&) = delete;
  FairWorkers& operator=(const FairWorkers&) = delete;

  // `done` is called exactly once: with nothing when `work` has returned, with what it threw, or with
  // Error(kCancelled | kDeadline | kUnavailable) when it was given up or never began. It must not block or
  // throw. Both are destroyed before the job counts as ended. Throws Error(kExhausted | kUnavailable); `done`
  // is not called then.
  using Done = std::function<void(std::exception_ptr)>;
  Id post(const JobTerms&, std::function<void()> work, Done done);
  // Ends the job: at once if it has not begun, else at its next look. Does nothing once it has ended.
  void cancel(Id);
  // The job that this thread works on. Throws std::logic_error on a thread that is none of these.
  Id current() const;
  // Those that this thread is one of. Throws std::logic_error where it is none.
  static FairWorkers& here();
  // For the job of this thread, which can do nothing before `other` has ended: gives the turn to it, and
  // returns when it has. Throws as a check_cancelled() does, and as current().
  void step_aside(Id other);
  // When a job on these terms would be done, if it were posted now.
  double done_in_s(const JobTerms&) const;
  // That jobs were at work, of the time since the start.
  double worked_s() const;
  // Since whoever works has looked up; 0: nobody works.
  double silent_s() const;

  // Cancels everything and waits for what runs to look; later jobs are refused.
  void stop();

  // The value of `work`, or its exception.
  template <class Work>
  auto run(const JobTerms& terms, Work work) {
    using Result = std::invoke_result_t<Work>;
    auto task = std::make_shared<std::packaged_task<Result()>>(std::move(work));
    auto failed = std::make_shared<std::promise<Result>>();
    Running<Result> running{failed->get_future(), 0};
    running.id = post(
        terms, [task] { (*task)(); },
        [task, failed,
         value = std::make_shared<std::future<Result>>(task->get_future())](std::exception_ptr error) {
          if (error) return failed->set_exception(error);
          settle(*value, *failed);
        });
    return running;
  }
  template <class Result>
  struct Running {
    std::future<Result> future;
    Id id;
  };

 private:
  struct Job {
    std::function<void()> work;
    Done done;
    bool cancelled = false, has_thread = false;
    JobTerms::Time deadline;
    std::condition_variable turn;
  };
  template <class Result>
  static void settle(std::future<Result>& value, std::promise<Result>& to) try {
    if constexpr (std::is_void_v<Result>) {
      value.get();
      to.set_value();
    } else {
      to.set_value(value.get());
    }
  } catch (...) {
    to.set_exception(std::current_exception());
  }
  using Lock = std::unique_lock<std::mutex>;
  void work();
  void work_on(Id, Job&, Lock&);
  void look_up(Id, Job&);
  void make_way(Id, Job&, Lock&);
  void charge(Id);
  void dispatch();
  void end(Id, std::exception_ptr, Lock&);
  void drop_expired(Lock&);
  void forbid(const Job&) const;

  mutable std::mutex mutex_;
  FairQueue queue_;
  std::map<Id, std::shared_ptr<Job>> jobs_;
  Id running_ = 0, starting_ = 0;  // whose turn it is; the same while no thread has taken it up
  JobTerms::Time since_;           // that it has been charged until
  double worked_s_ = 0;
  std::size_t idle_ = 0;
  bool stop_ = false;
  std::condition_variable start_;
  std::list<std::thread> threads_;
};

}  // namespace teletact::service
