#include "service/rpc/watch_reactor.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <stdexcept>

#include "service/scene/errors.h"

namespace teletact::service {

WatchReactor::WatchReactor(Core& core, grpc::CallbackServerContext* context)
    : ServedStream(core.calls, context, Allowance(2 * core.limits.most_finger_rate_hz)), core_(core) {}

WatchReactor* WatchReactor::serve(Core& core, grpc::CallbackServerContext* context) {
  return ServedCall::serve(std::make_shared<WatchReactor>(core, context), CallKind::kWatch);
}

void WatchReactor::take(const v1::WatchFingerRequest& request) {
  const std::lock_guard lock(mutex_);
  if (!scene_) {
    scene_ = core_.scenes.find(request.scene_id());
    spdlog::info("event=watch_opened stream={} scene={} peer={}", id(), scene_->id(), context_->peer());
    return;
  }
  if (!request.scene_id().empty())
    throw std::invalid_argument("scene_id: sent twice; acknowledge states, or open another stream");
  if (request.acknowledged() > written_ || request.acknowledged() < acknowledged_)
    throw std::invalid_argument(fmt::format(
        "acknowledged: {}, but {} states were sent and {} acknowledged; give the number of the newest state "
        "received",
        request.acknowledged(), written_, acknowledged_));
  acknowledged_ = request.acknowledged();
}

void WatchReactor::check() const {
  core_.calls.require_open();
  const std::lock_guard lock(mutex_);
  if (scene_ && scene_->deleted())
    throw Error(ErrorKind::kAborted, fmt::format("scene {} was deleted", scene_->id()));
}

void WatchReactor::tick(Clock::time_point now) {
  ServedStream::tick(now);
  if (compose(now)) write(state_);
}

bool WatchReactor::compose(Clock::time_point now) {
  const std::lock_guard lock(mutex_);
  if (!scene_) {
    if (now - since_ > seconds(core_.limits.first_message_s))
      throw Error(ErrorKind::kDeadline, fmt::format("scene_id: not sent within {} s; open a new stream",
                                                    core_.limits.first_message_s));
    return false;
  }
  if (acknowledged_ < written_ || writing()) {
    if (now - since_ > seconds(core_.limits.acknowledge_s))
      throw Error(ErrorKind::kDeadline, fmt::format("acknowledged: state {} was not within {} s; acknowledge "
                                                    "each state, or open a new stream",
                                                    written_, core_.limits.acknowledge_s));
    return false;
  }
  if (written_ > 0 && now - since_ < seconds(1 / core_.limits.most_finger_rate_hz)) return false;
  const Finger finger = scene_->finger().at(now);
  // One that rests is told all the same: watchers take silence for a dead link, and proxies for an idle one.
  if (written_ > 0 && finger.generation == generation_ && now - since_ < kHeartbeat) return false;
  generation_ = finger.generation;
  since_ = now;
  state_.Clear();
  state_.set_state(++written_);
  state_.set_present(finger.present);
  state_.set_session_id(finger.session_id);
  state_.set_scene_version(scene_->snapshot()->version);
  if (finger.stamp_ns == 0) return true;
  for (const double x_m : finger.position_m) state_.add_position_m(x_m);
  for (const double v_m_s : finger.velocity_m_s) state_.add_velocity_m_s(v_m_s);
  state_.mutable_stamp()->set_monotonic_ns(finger.stamp_ns);
  state_.mutable_stamp()->set_instance(core_.instance);
  return true;
}

void WatchReactor::closed() {
  if (!scene_) return;
  spdlog::info("event=watch_closed stream={} scene={} states={} code={}", id(), scene_->id(), written_,
               static_cast<int>(life().status().error_code()));
  scene_.reset();
}

}  // namespace teletact::service
