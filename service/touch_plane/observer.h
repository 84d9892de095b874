// Those who look at a scene: when each is to be sent, and what.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>

#include "service/scene/scene.h"

namespace teletact::service {

// Who is told the states of something in a scene, with a credit of one: the next is sent once the last is
// acknowledged, so that a reader that stops reading is never more than one state behind. Thread-safe.
class SceneWatcher {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds kHeartbeat{500};  // between states where nothing changes

  Scene& scene() const { return *scene_; }
  // The newest state that was received. Throws std::invalid_argument for one that was not sent.
  void acknowledge(std::uint64_t state);
  // States that were sent; they are counted from 1.
  std::uint64_t count() const;

 protected:
  explicit SceneWatcher(std::shared_ptr<Scene> scene) : scene_(std::move(scene)) {}
  // The rest under the mutex. Whether the next may be sent. `sent`: the last was sent. Throws
  // Error(kDeadline) when that is not acknowledged for too long.
  bool may_tell(Clock::time_point now, bool sent) const;
  // Its number.
  std::uint64_t tell(Clock::time_point now);

  const std::shared_ptr<Scene> scene_;
  mutable std::mutex mutex_;
  std::uint64_t count_ = 0, acknowledged_ = 0;
  Clock::time_point since_{};  // the last was sent
};

// One watcher of a scene's finger: the newest state, at most at the rate of the limits.
class FingerWatch : public SceneWatcher {
 public:
  struct State {
    std::uint64_t number = 0;
    Finger finger;
    std::uint64_t scene_version = 0;
  };

  explicit FingerWatch(std::shared_ptr<Scene> scene) : SceneWatcher(std::move(scene)) {}
  // What is to be sent now, if anything; `sent` as may_tell()'s.
  std::optional<State> due(Clock::time_point now, bool sent);

 private:
  std::uint64_t generation_ = 0;  // of the last one's finger
};

// One who looks on at a scene: the newest of the touch that it looks at, at most at its rate.
class Observer : public SceneWatcher {
 public:
  static constexpr double kMinRateHz = 0.1;
  struct State {
    std::uint64_t number = 0;
    Finger finger;
    std::uint64_t scene_version = 0;
    Observers::News news;
  };

  // `max_rate_hz` 0: as the limits say. Throws std::invalid_argument (field named).
  Observer(std::shared_ptr<Scene>, const Observers::Options&, double max_rate_hz = 0);
  ~Observer() { scene_->observers()->leave(id_); }
  Observer(const Observer&) = delete;
  Observer& operator=(const Observer&) = delete;
  // As FingerWatch's; `more`: something beside the touch waits to be sent.
  std::optional<State> due(Clock::time_point now, bool sent, bool more);

 private:
  const Clock::duration period_;
  const Observers::Id id_;
  Clock::time_point due_{};            // of the next state
  std::uint64_t version_ = 0;          // as it was sent last
  std::optional<std::string> steers_;  // the same; none: nobody
  bool at_rest_ = true;                // no surface under a finger was sent since
};

}  // namespace teletact::service
