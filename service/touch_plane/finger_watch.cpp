#include "service/touch_plane/finger_watch.h"

namespace teletact::service {

void FingerWatch::acknowledge(std::uint64_t state) {
  const std::lock_guard lock(mutex_);
  told_.acknowledge(state);
}

std::optional<FingerWatch::State> FingerWatch::due(Clock::time_point now, bool told) {
  const std::lock_guard lock(mutex_);
  const Limits& limits = scene_->limits();
  if (!told_.may_tell(now, told, limits.acknowledge_s)) return std::nullopt;
  const auto passed = now - told_.since();
  if (told_.count() > 0 && passed < seconds(1 / limits.max_finger_rate_hz)) return std::nullopt;
  const Finger finger = scene_->finger().at(now);
  // One that rests is told all the same: watchers take silence for a dead link, and proxies for an idle one.
  if (told_.count() > 0 && finger.generation == generation_ && passed < kHeartbeat) return std::nullopt;
  generation_ = finger.generation;
  return State{told_.tell(now), finger, scene_->snapshot()->version};
}

std::uint64_t FingerWatch::count() const {
  const std::lock_guard lock(mutex_);
  return told_.count();
}

}  // namespace teletact::service
