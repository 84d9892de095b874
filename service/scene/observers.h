// Who looks on at a scene: touch streams leave here what is looked for, in the place of what was not taken.
// Whoever answers a finger waits for no observer. Thread-safe.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <string>

#include "service/contact/touch_model.h"

namespace teletact::service {

struct ObservedTouch;  // an answer: touch_plane's, which alone looks into it

// How the touched layer gives way under a finger.
struct ObservedSurface {
  std::uint64_t sequence = 0;                  // of the pose
  std::chrono::steady_clock::time_point at{};  // when that arrived: none replaces a later one
  double depth_m = 0;                          // of the undeformed layer
  DeformedLayer layer;                         // empty out of contact
  std::chrono::nanoseconds took{};
};

class Observers {
 public:
  using Clock = std::chrono::steady_clock;
  using Id = std::uint64_t;
  struct Options {
    bool answers = false, surface = false;
    std::string session_id = {};  // of the touch stream that is looked at; empty: the one that steers
  };
  // The newest of each since the last time; null: none.
  struct News {
    std::shared_ptr<const ObservedTouch> touch;
    std::shared_ptr<const ObservedSurface> surface;
  };
  Id join(Options);
  void leave(Id);
  News take(Id);

  // For touch streams.
  struct From {
    const std::string& session_id;
    bool steers;
  };
  struct Wanted {
    bool touch = false, surface = false;
  };
  bool any() const { return any_.load(std::memory_order_relaxed); }
  // By somebody who looks at this stream.
  Wanted wanted(const From&) const;
  void tell(const From&, const std::shared_ptr<const ObservedTouch>&);
  void tell(const From&, const std::shared_ptr<const ObservedSurface>&);

 private:
  struct One {
    Options options;
    News news;
    Clock::time_point surface_at{};  // of the last that was told
    bool looks_at(const From&) const;
  };
  std::atomic<bool> any_{false};
  mutable std::mutex mutex_;
  std::map<Id, One> all_;
  Id last_ = 0;
};

}  // namespace teletact::service
