#include "service/touch_plane/observer.h"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

#include "service/base/seconds.h"
#include "service/scene/errors.h"
#include "service/touch_plane/touch_stream.h"

namespace teletact::service {

void SceneWatcher::acknowledge(std::uint64_t state) {
  const std::lock_guard lock(mutex_);
  if (state > count_ || state < acknowledged_)
    throw std::invalid_argument(fmt::format(
        "acknowledged: {}, but {} states were sent and {} acknowledged; give the number of the newest "
        "state received",
        state, count_, acknowledged_));
  acknowledged_ = state;
}

std::uint64_t SceneWatcher::count() const {
  const std::lock_guard lock(mutex_);
  return count_;
}

bool SceneWatcher::may_tell(Clock::time_point now, bool sent) const {
  if (acknowledged_ == count_ && sent) return true;
  const double acknowledge_s = scene_->limits().acknowledge_s;
  if (now - since_ > seconds(acknowledge_s))
    throw Error(ErrorKind::kDeadline, fmt::format("acknowledged: state {} was not within {} s; acknowledge "
                                                  "each state, or open a new stream",
                                                  count_, acknowledge_s));
  return false;
}

std::uint64_t SceneWatcher::tell(Clock::time_point now) {
  since_ = now;
  return ++count_;
}

std::optional<FingerWatch::State> FingerWatch::due(Clock::time_point now, bool sent) {
  const std::lock_guard lock(mutex_);
  if (!may_tell(now, sent)) return std::nullopt;
  const auto passed = now - since_;
  if (count_ > 0 && passed < seconds(1 / scene_->limits().max_finger_rate_hz)) return std::nullopt;
  const Finger finger = scene_->finger().at(now);
  // One that rests is sent all the same: watchers take silence for a dead link, and proxies for an idle one.
  if (count_ > 0 && finger.generation == generation_ && passed < kHeartbeat) return std::nullopt;
  generation_ = finger.generation;
  return State{tell(now), finger, scene_->snapshot()->version};
}

namespace {

Observer::Clock::duration observation_period(double wished_hz, const Limits& limits) {
  if (wished_hz == 0) wished_hz = limits.max_observe_rate_hz;
  if (!(wished_hz >= Observer::kMinRateHz && wished_hz <= limits.max_observe_rate_hz))
    throw std::invalid_argument(
        fmt::format("open.max_rate_hz: {} is not within [{}, {}]; leave it out for {}", wished_hz,
                    Observer::kMinRateHz, limits.max_observe_rate_hz, limits.max_observe_rate_hz));
  return seconds(1 / wished_hz);
}

const Observers::Options& checked(const Observers::Options& options) {
  if (options.session_id.size() > TouchStream::kMaxSessionIdBytes)
    throw std::invalid_argument(fmt::format("open.session_id: {} bytes; a touch stream's has at most {}",
                                            options.session_id.size(), TouchStream::kMaxSessionIdBytes));
  return options;
}

}  // namespace

Observer::Observer(std::shared_ptr<Scene> scene, const Observers::Options& options, double max_rate_hz)
    : SceneWatcher(std::move(scene)),
      period_(observation_period(max_rate_hz, scene_->limits())),
      id_(scene_->observers()->join(checked(options))) {}

std::optional<Observer::State> Observer::due(Clock::time_point now, bool sent, bool more) {
  const std::lock_guard lock(mutex_);
  if (!may_tell(now, sent)) return std::nullopt;
  if (now < due_) return std::nullopt;
  State state{0, scene_->finger().at(now), scene_->snapshot()->version, scene_->observers()->take(id_)};
  if (state.news.surface && state.news.surface->layer.x_m.empty()) {
    if (at_rest_) state.news.surface.reset();  // it is known
  }
  const auto steers = state.finger.present ? std::optional(state.finger.session_id) : std::nullopt;
  const bool news =
      state.news.touch || state.news.surface || more || state.scene_version != version_ || steers != steers_;
  if (count_ > 0 && !news && now - since_ < kHeartbeat) return std::nullopt;
  if (state.news.surface) at_rest_ = state.news.surface->layer.x_m.empty();
  version_ = state.scene_version, steers_ = steers;
  // Looked at late, it is sent sooner the next time.
  due_ = (count_ == 0 ? now : std::max(due_, now - period_)) + period_;
  state.number = tell(now);
  return state;
}

}  // namespace teletact::service
