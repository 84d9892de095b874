// The threads on which touch streams are worked: as many as there are cores, at normal priority, and whose
// turn it is says TouchQueue. Thread-safe.
#pragma once

#include <condition_variable>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <unordered_map>
#include <vector>

#include "service/base/limits.h"
#include "service/touch_plane/touch_queue.h"

namespace teletact::service {

// What a stream has done, one turn at a time.
class TouchTurns {
 public:
  using Time = TouchQueue::Time;
  struct Done {
    Time next;      // when the next turn is wanted; Time::max(): not before wake()
    bool answered;  // a pose was
    bool left;      // it was the last
  };
  virtual ~TouchTurns() = default;
  // On a worker's thread. `period`: that is kept between answers now. Must not throw.
  virtual Done turn(TouchQueue::Clock::duration period) = 0;
  // After the last turn: no worker knows it any more. On the same thread.
  virtual void left() = 0;
};

class TouchWorkers {
 public:
  using Clock = TouchQueue::Clock;
  using Id = TouchQueue::Id;

  explicit TouchWorkers(const Limits&);
  ~TouchWorkers();  // waits for the turns that run
  TouchWorkers(const TouchWorkers&) = delete;
  TouchWorkers& operator=(const TouchWorkers&) = delete;

  // As TouchQueue's.
  std::optional<std::string> overload(const TouchQueue::Principal&, TouchQueue::TurnKind);
  void wake(Id, Clock::time_point due);
  // `turns` stays until left(). No turn before the first wake().
  Id join(const TouchQueue::Principal&, Clock::duration period, TouchTurns& turns);

 private:
  using Lock = std::unique_lock<std::mutex>;
  void work();
  void wait(Lock&);
  void take_turn(const TouchQueue::Turn&, Lock&);
  std::mutex mutex_;
  std::condition_variable changed_;
  TouchQueue queue_;
  std::unordered_map<Id, TouchTurns*> turns_;
  std::size_t idle_ = 0;
  // Of the idle ones one waits for what is due next, until then at most; the others for it.
  Clock::time_point watched_ = Clock::time_point::max();
  bool stop_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace teletact::service
