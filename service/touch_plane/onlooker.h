// One who looks on at a scene: when it is to be told, and what of the touch that it looks at. The newest, at
// most at its rate, and only once it has acknowledged the last state. Thread-safe.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "service/scene/scene.h"
#include "service/touch_plane/told_states.h"

namespace teletact::service {

class Onlooker {
 public:
  using Clock = ToldStates::Clock;
  static constexpr std::chrono::milliseconds kHeartbeat{500};  // between states where nothing changes
  static constexpr double kMinRateHz = 0.1;

  struct Wishes {
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
  Onlooker(std::shared_ptr<Scene>, const Wishes&);
  ~Onlooker() { scene_->observers()->leave(id_); }
  Onlooker(const Onlooker&) = delete;
  Onlooker& operator=(const Onlooker&) = delete;
  Scene& scene() const { return *scene_; }
  // As FingerWatch's.
  void acknowledge(std::uint64_t state);
  // What is to be told now, if anything. `told`: the last was sent; `more`: something beside the touch waits
  // to be. Throws Error(kDeadline) as FingerWatch does.
  std::optional<State> due(Clock::time_point now, bool told, bool more);
  std::uint64_t count() const;

 private:
  const std::shared_ptr<Scene> scene_;
  const Clock::duration period_;
  const Observers::Id id_;
  mutable std::mutex mutex_;
  ToldStates told_;
  Clock::time_point due_{};            // of the next state
  std::uint64_t version_ = 0;          // as it was told last
  std::optional<std::string> steers_;  // the same; none: nobody
  bool at_rest_ = true;                // no surface under a finger was told since
};

}  // namespace teletact::service
