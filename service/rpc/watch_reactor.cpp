#include "service/rpc/services.h"

#include <spdlog/spdlog.h>

#include <atomic>
#include <memory>
#include <optional>
#include <stdexcept>

#include "service/rpc/call_metadata.h"
#include "service/rpc/core.h"
#include "service/rpc/palpation_messages.h"
#include "service/rpc/served_call.h"
#include "service/touch_plane/observer.h"
#include "teletact/v1/palpation.pb.h"

namespace teletact::service {

namespace {

// One watcher of a scene's finger. It is written to when it is looked at (Calls::kTick, so at most 100 times
// a second): no thread waits for it.
class WatchReactor final : public ServedStream<v1::WatchFingerRequest, v1::FingerState> {
 public:
  WatchReactor(Core& core, grpc::CallbackServerContext* context)
      : ServedStream(core, context, Allowance(2 * core.limits.max_finger_rate_hz)), core_(core) {}
  static WatchReactor* serve(Core& core, grpc::CallbackServerContext* context) {
    return ServedCall::serve(std::make_shared<WatchReactor>(core, context), CallKind::kWatch);
  }

 private:
  std::optional<Wanted> wanted(const v1::WatchFingerRequest& request) const override {
    return Wanted{Need::kFollow, request.scene_id()};
  }
  void take(const v1::WatchFingerRequest& request) override {
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
  void tick(Clock::time_point now) override {
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
  void check() const override {
    core_.calls.require_staying();
    if (opened_) watch_->scene().require_exists();
  }
  void closed() override {
    if (!opened_) return;
    spdlog::info("event=watch_closed stream={} scene={} states={} code={}", id(), watch_->scene().id(),
                 watch_->count(), static_cast<int>(life().status().error_code()));
    watch_.reset();
  }

  Core& core_;
  const Clock::time_point begun_ = Clock::now();
  std::unique_ptr<FingerWatch> watch_;
  std::atomic<bool> opened_{false};  // watch_ is there
  v1::FingerState state_;            // not touched while a write is under way
};

}  // namespace

grpc::ServerBidiReactor<v1::WatchFingerRequest, v1::FingerState>* serve_watch(
    Core& core, grpc::CallbackServerContext* context) {
  return WatchReactor::serve(core, context);
}

}  // namespace teletact::service
