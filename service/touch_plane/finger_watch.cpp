#include "service/touch_plane/finger_watch.h"

#include <fmt/format.h>

#include <stdexcept>

#include "service/scene/errors.h"

namespace teletact::service {

void FingerWatch::acknowledge(std::uint64_t state) {
  const std::lock_guard lock(mutex_);
  if (state > count_ || state < acknowledged_)
    throw std::invalid_argument(fmt::format(
        "acknowledged: {}, but {} states were sent and {} acknowledged; give the number of the newest state "
        "received",
        state, count_, acknowledged_));
  acknowledged_ = state;
}

std::optional<FingerWatch::State> FingerWatch::due(Clock::time_point now, bool told) {
  const std::lock_guard lock(mutex_);
  const Limits& limits = scene_->limits();
  const double passed_s = std::chrono::duration<double>(now - since_).count();
  if (acknowledged_ < count_ || !told) {
    if (passed_s > limits.acknowledge_s)
      throw Error(ErrorKind::kDeadline, fmt::format("acknowledged: state {} was not within {} s; acknowledge "
                                                    "each state, or open a new stream",
                                                    count_, limits.acknowledge_s));
    return std::nullopt;
  }
  if (count_ > 0 && passed_s < 1 / limits.most_finger_rate_hz) return std::nullopt;
  const Finger finger = scene_->finger().at(now);
  // One that rests is told all the same: watchers take silence for a dead link, and proxies for an idle one.
  if (count_ > 0 && finger.generation == generation_ && now - since_ < kHeartbeat) return std::nullopt;
  generation_ = finger.generation;
  since_ = now;
  return State{++count_, finger, scene_->snapshot()->version};
}

std::uint64_t FingerWatch::count() const {
  const std::lock_guard lock(mutex_);
  return count_;
}

}  // namespace teletact::service
