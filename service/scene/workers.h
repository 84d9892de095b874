// The threads that do what a Schedule says: imaging's jobs with each device, and what is done in the
// background, such as writing to disk. One job has a device's turns at a time, and gives way at a
// check_cancelled() (service/device/cancellation.h); a job that gave way keeps its thread and goes on later.
// The threads run at a raised nice value, so that touch, at normal priority, never waits for them (T1).
// Thread-safe.
#pragma once

#include <condition_variable>
#include <exception>
#include <functional>
#include <future>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <type_traits>
#include <variant>

#include "service/scene/schedule.h"

namespace teletact::service {

// Raises the nice value of this thread alone, for work that touch, at normal priority, must not wait for
// (T1).
void be_nice();

class Workers {
 public:
  using Clock = std::chrono::steady_clock;
  using Id = Schedule::Id;

  Workers() = default;
  ~Workers();  // stops
  Workers(const Workers&) = delete;
  Workers& operator=(const Workers&) = delete;

  // `done` is called exactly once: with nothing when `work` has returned, with what it threw, or with
  // Error(kCancelled | kDeadline | kUnavailable) when it was given up or never began. It must not block or
  // throw. Both are destroyed before the job counts as ended. Throws Error(kExhausted | kUnavailable); `done`
  // is not called then.
  using Done = std::function<void(std::exception_ptr)>;
  Id post(const JobTerms&, std::function<void()> work, Done done);
  // In the background, in turns of the clients; jobs of one are done in order. Dropped once the workers were
  // stopped. What it throws is logged.
  Id post(std::function<void()> work, const std::string& client = {});
  // Ends the job: at once if it has not begun, else at its next look. Does nothing once it has ended.
  void cancel(Id);
  // The device of the job that this thread works on. Throws std::logic_error on a thread that is none of
  // these.
  std::size_t device_here() const;
  // Has `work` done by the job of this thread while no other job has `what`. False: another device's job had
  // it for all of `patience`, it was not done, and this one has no turn: it is to end. Throws as a
  // check_cancelled() does, and as device_here().
  bool do_alone(const void* what, Clock::duration patience, const std::function<void()>& work);
  // When a job on these terms would be done, if it were posted now.
  double done_in_s(const JobTerms&) const;
  // That jobs were at work with the device, of the time since the start.
  double worked_s(std::size_t device) const;
  // Since whoever works with the device has looked up; 0: nobody works.
  double silent_s(std::size_t device) const;

  // Waits for every job posted so far, then stops.
  void finish();
  // Cancels everything and waits for what runs to look, in the background to end; later jobs are refused.
  void stop();

  // The value of `work`, or its exception.
  template <class Work>
  auto run(const JobTerms& terms, Work work) {
    using Result = std::invoke_result_t<Work>;
    constexpr bool kNone = std::is_void_v<Result>;
    const auto promise = std::make_shared<std::promise<Result>>();
    const auto value = std::make_shared<std::optional<std::conditional_t<kNone, std::monostate, Result>>>();
    Running<Result> running{promise->get_future(), 0};
    running.id = post(
        terms,
        [work = std::move(work), value]() mutable {
          if constexpr (kNone)
            work();
          else
            value->emplace(work());
        },
        [promise, value](const std::exception_ptr& error) {
          if (error) return promise->set_exception(error);
          if constexpr (kNone)
            promise->set_value();
          else
            promise->set_value(*std::move(*value));
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
    JobTerms terms;
    std::function<void()> work;
    Done done;
    bool cancelled = false, has_thread = false;
    std::condition_variable turn;
  };
  struct Turn {
    Id running = 0;        // whose it is
    JobTerms::Time since;  // that it has been charged until
    double worked_s = 0;
  };
  using Lock = std::unique_lock<std::mutex>;
  void work();
  void work_on(Id, Job&, Lock&);
  void look_up(Id, Job&);
  bool make_way(Id, Job&, JobTerms::Time until, Lock&);
  void charge(Id, const Job&);
  void dispatch();
  void dispatch(std::size_t device, Turn&);
  void end(Id, std::exception_ptr, Lock&);
  void drop_expired(Lock&);
  void forbid(const Job&) const;

  mutable std::mutex mutex_;
  Schedule schedule_;
  std::map<Id, std::shared_ptr<Job>> jobs_;
  std::map<std::size_t, Turn> turns_;  // by device
  std::set<Id> starting_;              // have their turn, and no thread has taken them up
  std::size_t idle_ = 0;
  bool stop_ = false;
  std::condition_variable start_, ended_;
  std::list<std::thread> threads_;
};

}  // namespace teletact::service
