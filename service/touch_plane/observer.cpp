#include "service/touch_plane/observer.h"

#include <algorithm>

#include "service/touch_plane/touch_stream.h"

namespace teletact::service {

namespace {

Observer::Clock::duration observation_period(double wished_hz, const Limits& limits) {
  if (wished_hz == 0) wished_hz = limits.max_observe_rate_hz;
  if (!(wished_hz >= Observer::kMinRateHz && wished_hz <= limits.max_observe_rate_hz))
    throw std::invalid_argument(
        fmt::format("open.max_rate_hz: {} is not within [{}, {}]; leave it out for {}", wished_hz,
                    Observer::kMinRateHz, limits.max_observe_rate_hz, limits.max_observe_rate_hz));
  return seconds(1 / wished_hz);
}

const std::string& checked(const std::string& session_id) {
  if (session_id.size() > TouchStream::kMaxSessionIdBytes)
    throw std::invalid_argument(fmt::format("open.session_id: {} bytes; a touch stream's has at most {}",
                                            session_id.size(), TouchStream::kMaxSessionIdBytes));
  return session_id;
}

}  // namespace

Observer::Observer(std::shared_ptr<Scene> scene, const Options& options)
    : scene_(std::move(scene)),
      period_(observation_period(options.max_rate_hz, scene_->limits())),
      id_(scene_->observers()->join({options.answers, options.surface, checked(options.session_id)})) {}

void Observer::acknowledge(std::uint64_t state) {
  const std::lock_guard lock(mutex_);
  sent_.acknowledge(state);
}

std::optional<Observer::State> Observer::due(Clock::time_point now, bool sent, bool more) {
  const std::lock_guard lock(mutex_);
  if (!sent_.may_tell(now, sent, scene_->limits().acknowledge_s)) return std::nullopt;
  if (now < due_) return std::nullopt;
  State state{0, scene_->finger().at(now), scene_->snapshot()->version, scene_->observers()->take(id_)};
  if (state.news.surface && state.news.surface->layer.x_m.empty()) {
    if (at_rest_) state.news.surface.reset();  // it is known
  }
  const auto steers = state.finger.present ? std::optional(state.finger.session_id) : std::nullopt;
  const bool news =
      state.news.touch || state.news.surface || more || state.scene_version != version_ || steers != steers_;
  if (sent_.count() > 0 && !news && now - sent_.since() < kHeartbeat) return std::nullopt;
  if (state.news.surface) at_rest_ = state.news.surface->layer.x_m.empty();
  version_ = state.scene_version, steers_ = steers;
  // Looked at late, it is sent sooner the next time.
  due_ = (sent_.count() == 0 ? now : std::max(due_, now - period_)) + period_;
  state.number = sent_.tell(now);
  return state;
}

std::uint64_t Observer::count() const {
  const std::lock_guard lock(mutex_);
  return sent_.count();
}

}  // namespace teletact::service
