#include "service/rpc/services.h"

#include <spdlog/spdlog.h>

#include <atomic>
#include <memory>
#include <optional>
#include <stdexcept>

#include "service/rpc/call_metadata.h"
#include "service/rpc/core.h"
#include "service/rpc/palpation_messages.h"
#include "service/rpc/scene_news.h"
#include "service/rpc/served_call.h"
#include "service/rpc/touch_messages.h"
#include "service/touch_plane/observer.h"
#include "service/touch_plane/touch_stream.h"
#include "teletact/v1/palpation.pb.h"

namespace teletact::service {

namespace {

void surface_to(const ObservedSurface& in, v1::DeformedSurface* out) {
  out->set_sequence(in.sequence);
  out->set_depth_m(in.depth_m);
  out->mutable_x_m()->Add(in.layer.x_m.begin(), in.layer.x_m.end());
  out->mutable_z_m()->Add(in.layer.z_m.begin(), in.layer.z_m.end());
  v1::Array* array = out->mutable_displacement_m();
  array->set_dtype(v1::DATA_TYPE_FLOAT32);
  array->add_shape(static_cast<std::uint32_t>(in.layer.z_m.size()));
  array->add_shape(static_cast<std::uint32_t>(in.layer.x_m.size()));
  array->set_data(in.layer.displacement_m.data(), in.layer.displacement_m.size() * sizeof(float));
  out->set_compute_ns(in.took.count());
}

void touch_to(const ObservedTouch& in, std::uint64_t instance, v1::TouchAnswer* out) {
  answer_to(in.answered, instance, out);
  out->set_steers(in.answered.steering.steers);
  out->set_steered_by(in.answered.steering.by);
  stamp_to(monotonic_ns(in.at), instance, out->mutable_answer_stamp());
}

// One who looks on at a scene. It is written to when it is looked at (Calls::kTick): no thread waits for it.
class ObserveReactor final : public ServedStream<v1::ObserveRequest, v1::Observation> {
 public:
  ObserveReactor(Core& core, Workers& copying, grpc::CallbackServerContext* context)
      : ServedStream(core, context, Allowance(2 * core.limits.max_observe_rate_hz)),
        core_(core),
        copying_(copying) {}
  // `copying`: makes what is large.
  static ObserveReactor* serve(Core& core, Workers& copying, grpc::CallbackServerContext* context) {
    return ServedCall::serve(std::make_shared<ObserveReactor>(core, copying, context), CallKind::kObserve);
  }

 private:
  std::optional<Wanted> wanted(const v1::ObserveRequest& request) const override {
    if (!request.has_open()) return std::nullopt;
    return Wanted{Need::kRead, request.open().scene_id()};
  }
  void take(const v1::ObserveRequest& request) override {
    if (request.has_open())
      open(request.open());
    else if (!opened_)
      throw std::invalid_argument("open: the first message of an observer must be open");
    else if (request.kind_case() == v1::ObserveRequest::kAcknowledged)
      observer_->acknowledge(request.acknowledged());
    else
      throw std::invalid_argument("kind: empty request; send open, then acknowledge each state");
  }
  void tick(Clock::time_point now) override {
    ServedStream::tick(now);
    if (!opened_) return core_.calls.require_first_message("open", begun_, now);
    news_->look();
    const auto state = observer_->due(now, !writing(), news_->ready());
    if (!state) return;
    state_.Clear();
    state_.set_state(state->number);
    stamp_to(monotonic_ns(now), core_.instance, state_.mutable_stamp());
    state_.set_scene_version(state->scene_version);
    state_.set_steered(state->finger.present);
    state_.set_steered_by(state->finger.session_id);
    news_->take(state_);
    if (state->news.touch) touch_to(*state->news.touch, core_.instance, state_.mutable_answer());
    if (state->news.surface) surface_to(*state->news.surface, state_.mutable_surface());
    if (write(state_)) core_.metrics.observation();
  }
  void check() const override {
    core_.calls.require_open();
    if (opened_) observer_->scene().require_exists();
  }
  void closed() override {
    if (!opened_) return;
    spdlog::info("event=observe_closed stream={} scene={} states={} code={}", id(), observer_->scene().id(),
                 observer_->count(), static_cast<int>(life().status().error_code()));
    observer_.reset(), news_.reset();
  }

  void open(const v1::ObserveOpen& open) {
    if (opened_) throw std::invalid_argument("open: sent twice; acknowledge states, or open another stream");
    require_named(*context_, open.scene_id());
    const auto scene = core_.scenes.find(open.scene_id());
    news_ = std::make_unique<SceneNews>(core_, copying_, scene, client_of(*context_), open);
    observer_ = std::make_unique<Observer>(
        scene, Observers::Options{open.answers(), open.surface(), open.session_id()}, open.max_rate_hz());
    opened_ = true;
    spdlog::info("event=observe_opened stream={} scene={} peer={}", id(), scene->id(), context_->peer());
  }

  Core& core_;
  Workers& copying_;
  const Clock::time_point begun_ = Clock::now();
  std::unique_ptr<Observer> observer_;
  std::unique_ptr<SceneNews> news_;
  std::atomic<bool> opened_{false};  // both are there
  v1::Observation state_;            // not touched while a write is under way
};

}  // namespace

grpc::ServerBidiReactor<v1::ObserveRequest, v1::Observation>* serve_observe(
    Core& core, Workers& copying, grpc::CallbackServerContext* context) {
  return ObserveReactor::serve(core, copying, context);
}

}  // namespace teletact::service
