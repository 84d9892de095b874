// A thread at a raised nice value that does one job after another: what may take its time, such as the disk.
// Touch, at normal priority, never waits for it (T1). Whoever has many jobs takes turns with the others.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <thread>

namespace teletact::service {

// Raises the nice value of this thread alone, for work that touch, at normal priority, must not wait for
// (T1).
void be_nice();

class NicedWorker {
 public:
  NicedWorker();
  ~NicedWorker();
  NicedWorker(const NicedWorker&) = delete;
  NicedWorker& operator=(const NicedWorker&) = delete;

  // Waits for the job that runs and drops those that wait; later ones are dropped too.
  void stop();
  // Waits for every job posted so far, then stops.
  void finish();

  // Dropped once it was stopped. An exception of `job` is logged. Who posts bounds how many wait. `of`: whose
  // it is; jobs of one are done in order.
  using Id = std::uint64_t;  // never 0
  Id post(std::function<void()> job, const std::string& of = {});
  // Does nothing once it has begun.
  void drop(Id);

 private:
  void work();
  std::function<void()> take();
  std::mutex mutex_;
  std::condition_variable changed_;
  struct Job {
    Id id;
    std::function<void()> work;
  };
  std::map<std::string, std::deque<Job>> jobs_;  // none is empty
  std::string last_;                             // whose was taken
  Id posted_ = 0;
  bool stop_ = false, finish_ = false;
  std::thread thread_;
};

}  // namespace teletact::service
