// One watcher of a scene's finger: when it is to be sent of it. The newest state, at most at the rate of the
// limits, and only once it has acknowledged the last: a watcher that stops reading is never more than one
// state behind. Thread-safe.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>

#include "service/scene/scene.h"
#include "service/touch_plane/sent_states.h"

namespace teletact::service {

class FingerWatch {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds kHeartbeat{500};  // between states of a finger at rest

  struct State {
    std::uint64_t number = 0;  // counts the states from 1
    Finger finger;
    std::uint64_t scene_version = 0;
  };

  explicit FingerWatch(std::shared_ptr<Scene> scene) : scene_(std::move(scene)) {}
  Scene& scene() const { return *scene_; }
  // The newest state that was received. Throws std::invalid_argument for one that was not sent.
  void acknowledge(std::uint64_t state);
  // What is to be sent now, if anything. `sent`: the last was sent. Throws Error(kDeadline) when that is not
  // acknowledged for too long.
  std::optional<State> due(Clock::time_point now, bool sent);
  std::uint64_t count() const;

 private:
  const std::shared_ptr<Scene> scene_;
  mutable std::mutex mutex_;
  SentStates sent_;
  std::uint64_t generation_ = 0;  // of the last one's finger
};

}  // namespace teletact::service
