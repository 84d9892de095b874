#include "service/rpc/services.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <atomic>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>

#include "service/rpc/call_metadata.h"
#include "service/rpc/core.h"
#include "service/rpc/palpation_messages.h"
#include "service/rpc/served_call.h"
#include "service/rpc/touch_messages.h"
#include "service/scene/errors.h"
#include "service/touch_plane/touch_exchange.h"
#include "service/touch_plane/touch_stream.h"
#include "service/touch_plane/touch_workers.h"
#include "teletact/v1/palpation.pb.h"

namespace teletact::service {

namespace {

template <class Message>
void steering_to(FingerBoard::Steering steering, Message* out) {
  out->set_steers(steering.steers);
  out->set_steered_by(std::move(steering.by));
}

// In whose turn it is answered: who only observes has less of them than who steers.
TouchQueue::Principal principal_of(const TouchStreamOptions& options) {
  if (options.may_steer) return {options.touch.client, 1};
  return {"observer " + options.touch.client, TouchQueue::kObserverWeight};
}

// One touch stream. gRPC's threads bring its poses; the touch plane's workers answer and write.
class TouchReactor final : public ServedStream<v1::TouchRequest, v1::TouchResponse>, private TouchTurns {
 public:
  TouchReactor(Core& core, grpc::CallbackServerContext* context)
      : ServedStream(core, context, Allowance(2 * core.limits.max_touch_rate_hz)), core_(core) {}
  static TouchReactor* serve(Core& core, grpc::CallbackServerContext* context) {
    return ServedCall::serve(std::make_shared<TouchReactor>(core, context), CallKind::kTouch,
                             client_of(*context));
  }

 private:
  // Who may steer does so until it may no longer: then the stream ends, and another one observes.
  std::optional<Wanted> wanted(const v1::TouchRequest& request) const override {
    if (!request.has_open()) return std::nullopt;
    const Wanted steering{Need::kSteer, request.open().scene_id()};
    return caller_.may(steering) ? steering : Wanted{Need::kFeel, steering.scene};
  }
  void take(const v1::TouchRequest& request) override {
    if (request.has_open())
      open(request.open());
    else if (request.has_pose() && !opened_)
      throw std::invalid_argument("open: the first message of a touch stream must be open");
    else if (request.has_pose())
      bring(request.pose());
    else if (request.has_hand_over() && opened_)
      stream_->hand_over(request.hand_over().session_id());
    else
      throw std::invalid_argument("kind: empty request, or hand_over before open; send open, then pose");
  }
  void tick(Clock::time_point now) override {
    tell_of_slow(now);
    ServedStream::tick(now);
    if (opened_)
      stream_->require_poses(now);
    else
      core_.calls.require_first_message("open", begun_, now);
  }
  void check() const override {
    core_.calls.require_open();
    if (opened_) stream_->scene().require_exists();
  }
  void written() override {
    if (!opened_) return;
    stream_->written();
    wake();
  }
  void ended() override {
    if (!opened_) return;
    stream_->end();
    wake();
  }
  void closed() override {
    if (!stream_) return;
    tell_of_slow(Clock::now());
    const auto [poses, replaced, answers] = stream_->counts();
    spdlog::info(
        "event=touch_closed stream={} who=\"{}\" session=\"{}\" scene={} poses={} poses_replaced={} "
        "answers={} "
        "code={}",
        id(), who(), name_, stream_->scene().id(), poses, replaced, answers,
        static_cast<int>(life().status().error_code()));
    stream_.reset();
  }
  TouchTurns::Done turn(Clock::duration period) override {
    TouchStream::Said said;
    during([&] {
      said = stream_->turn(period);
      if (const auto* opened = std::get_if<TouchStream::Opened>(&said)) say(*opened);
      if (const auto* piece = std::get_if<LawPiece>(&said)) say(*piece);
      if (const auto* answered = std::get_if<TouchStream::Answered>(&said)) {
        say(*answered);
        stream_->look_ahead();
      }
    });
    if (life().ended()) {  // at once: the end itself may wait for the peer
      stream_->end();
      said = stream_->turn();
    }
    return {stream_->due(), std::holds_alternative<TouchStream::Answered>(said),
            std::holds_alternative<TouchStream::Left>(said)};
  }
  void left() override { release(); }  // OnDone may follow at once

  void wake() {
    if (const auto due = stream_->due(); due < Clock::time_point::max()) core_.touch.wake(turns_, due);
  }
  void open(const v1::TouchOpen& open) {
    if (opened_) throw std::invalid_argument("open: sent twice; send poses, or open another stream");
    require_named(*context_, open.scene_id());
    TouchStreamOptions options = stream_options_from(open);
    options.touch.client = client_of(*context_);
    options.may_steer = required().need == Need::kSteer;
    const TouchQueue::Principal principal = principal_of(options);
    const auto kind =
        options.touch.path == SolvePath::kGradients ? TouchQueue::kLongTurns : TouchQueue::kShortTurns;
    if (const auto load = core_.touch.overload(principal, kind)) core_.calls.refuse_for_load(id(), *load);
    stream_ =
        std::make_unique<TouchStream>(core_.scenes.find(open.scene_id()), std::move(options), core_.device);
    name_ = shown(open.session_id());
    spdlog::info(
        "event=touch_opened stream={} who=\"{}\" session=\"{}\" scene={} peer={} credit={} period_s={:.4f}",
        id(), who(), name_, stream_->scene().id(), context_->peer(), stream_->credit(),
        std::chrono::duration<double>(stream_->period()).count());
    if (!hold()) return;  // until left()
    try {
      turns_ = core_.touch.join(principal, stream_->period(), *this);
    } catch (...) {
      release();
      throw;
    }
    opened_ = true;
    wake();
  }
  void bring(const v1::ContactPose& pose) {
    core_.metrics.pose(stream_->bring(pose_from(pose)));
    wake();
  }
  void say(const TouchStream::Opened& said) {
    v1::TouchOpened* opened = response_.mutable_opened();
    opened->set_period_s(std::chrono::duration<double>(said.period).count());
    opened->set_credit(static_cast<std::uint32_t>(stream_->credit()));
    opened->set_instance(core_.instance);
    layer_to(stream_->layer(), opened->mutable_layer());
    region_to(stream_->covered(), opened->mutable_covered());
    steering_to(stream_->steering(), opened);
    write(response_);
  }
  void say(const TouchStream::Answered& answered) {
    v1::TouchAnswer* answer = response_.mutable_answer();  // replaces `opened`
    answer->Clear();
    answer_to(answered, core_.instance, answer);
    steering_to(answered.steering, answer);
    answer->set_moving(core_.calls.moving());
    stamp_to(monotonic_ns(), core_.instance, answer->mutable_answer_stamp());
    if (!write(response_)) return;
    core_.metrics.answer(answered);
    note_if_slow(answered);
  }
  void say(const LawPiece& piece) {
    law_to(piece, response_.mutable_law());  // replaces the answer
    if (write(response_)) core_.metrics.law_piece();
  }
  void note_if_slow(const TouchStream::Answered& answered) {
    if (!core_.slow_answers.too_long(answered.queued + answered.computing - answered.period)) return;
    const std::lock_guard lock(slow_mutex_);
    if (slow_.put({answered.queued, answered.computing})) core_.slow_answers.leave_out();
  }
  void tell_of_slow(Clock::time_point now) {
    std::optional<Slow> slow;
    {
      const std::lock_guard lock(slow_mutex_);
      slow = slow_.take();
    }
    if (!slow) return;
    core_.slow_answers.tell(now, [&] {
      return fmt::format("stream={} {}", id(),
                         key_values(slow->queued + slow->computed,
                                    {{"queued", slow->queued}, {"computed", slow->computed}}));
    });
  }

  Core& core_;
  const Clock::time_point begun_ = Clock::now();
  std::string name_;  // for logs: the client's session id
  std::unique_ptr<TouchStream> stream_;
  std::atomic<bool> opened_{false};  // stream_ is there

  TouchWorkers::Id turns_ = 0;
  v1::TouchResponse response_;  // of whose turn it is; not touched while a write is under way

  // A slow answer, told by the thread that looks after calls: who answers does not wait for the log.
  struct Slow {
    Clock::duration queued, computed;
  };
  std::mutex slow_mutex_;
  Mailbox<Slow> slow_;
};

}  // namespace

grpc::ServerBidiReactor<v1::TouchRequest, v1::TouchResponse>* serve_touch(
    Core& core, grpc::CallbackServerContext* context) {
  return TouchReactor::serve(core, context);
}

}  // namespace teletact::service
