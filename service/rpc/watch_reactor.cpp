#include "service/rpc/watch_reactor.h"

#include <spdlog/spdlog.h>

#include <stdexcept>

#include "service/rpc/call_metadata.h"
#include "service/rpc/palpation_messages.h"

namespace teletact::service {

WatchReactor::WatchReactor(Core& core, grpc::CallbackServerContext* context)
    : ServedStream(core, context, Allowance(2 * core.limits.max_finger_rate_hz)), core_(core) {}

WatchReactor* WatchReactor::serve(Core& core, grpc::CallbackServerContext* context) {
  return ServedCall::serve(std::make_shared<WatchReactor>(core, context), CallKind::kWatch);
}

std::optional<Wanted> WatchReactor::wanted(const v1::WatchFingerRequest& request) const {
  return Wanted{Need::kFollow, request.scene_id()};
}

void WatchReactor::take(const v1::WatchFingerRequest& request) {
  if (!opened_) {
    require_named(*context_, request.scene_id());
    watch_ = std::make_unique<FingerWatch>(core_.scenes.find(request.scene_id()));
    opened_ = true;
    spdlog::info("event=watch_opened stream={} scene={} peer={}", id(), watch_->scene().id(),
                 context_->peer());
    return;
  }
  if (!request.scene_id().empty())
    throw std::invalid_argument("scene_id: sent twice; acknowledge states, or open another stream");
  watch_->acknowledge(request.acknowledged());
}

void WatchReactor::check() const {
  core_.calls.require_staying();
  if (opened_) watch_->scene().require_exists();
}

void WatchReactor::tick(Clock::time_point now) {
  ServedStream::tick(now);
  if (!opened_) return core_.calls.require_first_message("scene_id", begun_, now);
  const auto state = watch_->due(now, !writing());
  if (!state) return;
  state_.Clear();
  state_.set_state(state->number);
  state_.set_scene_version(state->scene_version);
  const Finger& finger = state->finger;
  state_.set_present(finger.present);
  state_.set_session_id(finger.session_id);
  if (finger.stamp_ns != 0) {
    for (const double x_m : finger.position_m) state_.add_position_m(x_m);
    for (const double v_m_s : finger.velocity_m_s) state_.add_velocity_m_s(v_m_s);
    stamp_to(finger.stamp_ns, core_.instance, state_.mutable_stamp());
  }
  if (finger.wish) {
    state_.mutable_wish()->set_z_m(finger.wish->z_m);
    state_.mutable_wish()->set_half_width(finger.wish->half_width);
  }
  write(state_);
}

void WatchReactor::closed() {
  if (!opened_) return;
  spdlog::info("event=watch_closed stream={} scene={} states={} code={}", id(), watch_->scene().id(),
               watch_->count(), static_cast<int>(life().status().error_code()));
  watch_.reset();
}

}  // namespace teletact::service
