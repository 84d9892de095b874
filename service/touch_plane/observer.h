// One who looks on at a scene: when it is to be sent, and what of the touch that it looks at. The newest, at
// most at its rate, and only once it has acknowledged the last state. Thread-safe.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "service/scene/scene.h"
#include "service/touch_plane/sent_states.h"

namespace teletact::service {

class Observer {
 public:
  using Clock = SentStates::Clock;
  static constexpr std::chrono::milliseconds kHeartbeat{500};  // between states where nothing changes
  static constexpr double kMinRateHz = 0.1;

  struct Options {
    bool answers = false, surface = false;
    std::string session_id = {};  // of the touch stream; empty: the one that steers
    double max_rate_hz = 0;      // 0: as the limits say
  };
  struct State {
    std::uint64_t number = 0;  // counts the states from 1
    Finger finger;
    std::uint64_t scene_version = 0;
    Observers::News news;
  };

  // Throws std::invalid_argument (field named).
  Observer(std::shared_ptr<Scene>, const Options&);
  ~Observer() { scene_->observers()->leave(id_); }
  Observer(const Observer&) = delete;
  Observer& operator=(const Observer&) = delete;
  Scene& scene() const { return *scene_; }
  // As FingerWatch's.
  void acknowledge(std::uint64_t state);
  // What is to be sent now, if anything. `sent`: the last was sent; `more`: something beside the touch waits
  // to be. Throws Error(kDeadline) as FingerWatch does.
  std::optional<State> due(Clock::time_point now, bool sent, bool more);
  std::uint64_t count() const;

 private:
  const std::shared_ptr<Scene> scene_;
  const Clock::duration period_;
  const Observers::Id id_;
  mutable std::mutex mutex_;
  SentStates sent_;
  Clock::time_point due_{};            // of the next state
  std::uint64_t version_ = 0;          // as it was sent last
  std::optional<std::string> steers_;  // the same; none: nobody
  bool at_rest_ = true;                // no surface under a finger was sent since
};

}  // namespace teletact::service
