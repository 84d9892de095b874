#include "service/touch_plane/onlooker.h"

#include <algorithm>

#include "service/touch_plane/touch_stream.h"

namespace teletact::service {

namespace {

Onlooker::Clock::duration observation_period(double wished_hz, const Limits& limits) {
  if (wished_hz == 0) wished_hz = limits.max_observe_rate_hz;
  if (!(wished_hz >= Onlooker::kMinRateHz && wished_hz <= limits.max_observe_rate_hz))
    throw std::invalid_argument(
        fmt::format("open.max_rate_hz: {} is not within [{}, {}]; leave it out for {}", wished_hz,
                    Onlooker::kMinRateHz, limits.max_observe_rate_hz, limits.max_observe_rate_hz));
  return seconds(1 / wished_hz);
}

const std::string& checked(const std::string& session_id) {
  if (session_id.size() > TouchStream::kMaxSessionIdBytes)
    throw std::invalid_argument(fmt::format("open.session_id: {} bytes; a touch stream's has at most {}",
                                            session_id.size(), TouchStream::kMaxSessionIdBytes));
  return session_id;
}

}  // namespace

Onlooker::Onlooker(std::shared_ptr<Scene> scene, const Wishes& wishes)
    : scene_(std::move(scene)),
      period_(observation_period(wishes.max_rate_hz, scene_->limits())),
      id_(scene_->observers()->join({wishes.answers, wishes.surface, checked(wishes.session_id)})) {}

void Onlooker::acknowledge(std::uint64_t state) {
  const std::lock_guard lock(mutex_);
  told_.acknowledge(state);
}

std::optional<Onlooker::State> Onlooker::due(Clock::time_point now, bool told, bool more) {
  const std::lock_guard lock(mutex_);
  if (!told_.may_tell(now, told, scene_->limits().acknowledge_s)) return std::nullopt;
  if (now < due_) return std::nullopt;
  State state{0, scene_->finger().at(now), scene_->snapshot()->version, scene_->observers()->take(id_)};
  if (state.news.surface && state.news.surface->layer.x_m.empty()) {
    if (at_rest_) state.news.surface.reset();  // it is known
  }
  const auto steers = state.finger.present ? std::optional(state.finger.session_id) : std::nullopt;
  const bool news =
      state.news.touch || state.news.surface || more || state.scene_version != version_ || steers != steers_;
  if (told_.count() > 0 && !news && now - told_.since() < kHeartbeat) return std::nullopt;
  if (state.news.surface) at_rest_ = state.news.surface->layer.x_m.empty();
  version_ = state.scene_version, steers_ = steers;
  // Looked at late, it is told sooner the next time.
  due_ = (told_.count() == 0 ? now : std::max(due_, now - period_)) + period_;
  state.number = told_.tell(now);
  return state;
}

std::uint64_t Onlooker::count() const {
  const std::lock_guard lock(mutex_);
  return told_.count();
}

}  // namespace teletact::service
