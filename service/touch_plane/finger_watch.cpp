#include "service/touch_plane/finger_watch.h"

namespace teletact::service {

void FingerWatch::acknowledge(std::uint64_t state) {
  const std::lock_guard lock(mutex_);
  sent_.acknowledge(state);
}

std::optional<FingerWatch::State> FingerWatch::due(Clock::time_point now, bool sent) {
  const std::lock_guard lock(mutex_);
  const Limits& limits = scene_->limits();
  if (!sent_.may_tell(now, sent, limits.acknowledge_s)) return std::nullopt;
  const auto passed = now - sent_.since();
  if (sent_.count() > 0 && passed < seconds(1 / limits.max_finger_rate_hz)) return std::nullopt;
  const Finger finger = scene_->finger().at(now);
  // One that rests is sent all the same: watchers take silence for a dead link, and proxies for an idle one.
  if (sent_.count() > 0 && finger.generation == generation_ && passed < kHeartbeat) return std::nullopt;
  generation_ = finger.generation;
  return State{sent_.tell(now), finger, scene_->snapshot()->version};
}

std::uint64_t FingerWatch::count() const {
  const std::lock_guard lock(mutex_);
  return sent_.count();
}

}  // namespace teletact::service
