#include "bench/load/session.h"

#include <utility>

#include "client/link/scenes.h"

namespace teletact::bench {
namespace {

constexpr double kPeriodS = 0.001;
constexpr double kSooner = 0.9;  // of a period: instants are not as even as the service's

std::string name_of(grpc::StatusCode code) {
  switch (code) {
    case grpc::StatusCode::RESOURCE_EXHAUSTED:
      return "RESOURCE_EXHAUSTED";
    case grpc::StatusCode::UNAVAILABLE:
      return "UNAVAILABLE";
    case grpc::StatusCode::DEADLINE_EXCEEDED:
      return "DEADLINE_EXCEEDED";
    case grpc::StatusCode::NOT_FOUND:
      return "NOT_FOUND";
    case grpc::StatusCode::CANCELLED:
      return "CANCELLED";
    case grpc::StatusCode::FAILED_PRECONDITION:
      return "FAILED_PRECONDITION";
    case grpc::StatusCode::INVALID_ARGUMENT:
      return "INVALID_ARGUMENT";
    default:
      return "status " + std::to_string(static_cast<int>(code));
  }
}

}  // namespace

LoadSession::LoadSession(std::shared_ptr<grpc::Channel> channel, FingerPlan plan, Clock::time_point begin)
    : plan_(std::move(plan)),
      begin_(begin),
      channel_(std::move(channel)),
      stub_(v1::Palpation::NewStub(channel_)),
      called_s_(now_s()) {
  v1::TouchOpen& open = *request_.mutable_open();
  open = plan_.open;
  open.set_credit(plan_.in_flight);
  open.set_period_s(kPeriodS);
  client::name_scene(context_, open.scene_id());
  stub_->async()->Touch(&context_, this);
  AddHold();  // poses are sent from outside of reactions
  StartWrite(&request_);
  StartRead(&response_);
  StartCall();
}

LoadSession::~LoadSession() {
  end(End::kDropped);
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [&] { return done_; });
}

void LoadSession::intend(double due_s) {
  tally_.intended += due_s >= plan_.counted_from_s;
  if (newest_) tally_.held_back += newest_->due_s >= plan_.counted_from_s;
  newest_ = Pose{unanswered_.intend(due_s), due_s};
}

void LoadSession::intend_next() {
  const double now_s = this->now_s();
  if (plan_.closed_loop && sent_.empty() && !newest_ && !ending_ && now_s < plan_.until_s) intend(now_s);
}

void LoadSession::send_newest() {
  if (!newest_ || !opened_ || writing_ || ending_ || !held_ || sent_.size() >= plan_.in_flight) return;
  // As the product does: what is sent sooner than the service answers only costs it time.
  const double now_s = this->now_s();
  if (!plan_.greedy && !plan_.closed_loop && now_s < sent_s_ + kSooner * period_s_) return;
  sent_s_ = now_s;
  const Pose pose = *std::exchange(newest_, std::nullopt);
  request_.Clear();
  v1::ContactPose& out = *request_.mutable_pose();
  out.set_sequence(pose.sequence);
  out.set_acknowledged(acknowledged_);
  out.set_laws_acknowledged(laws_acknowledged_);
  out.mutable_stamp()->set_monotonic_ns(
      std::chrono::duration_cast<std::chrono::nanoseconds>(begin_.time_since_epoch()).count() +
      static_cast<std::int64_t>(pose.due_s * 1e9));
  plan_.pose(pose.due_s, out);
  sent_.push_back(pose.sequence);
  writing_ = true;
  StartWrite(&request_);
}

void LoadSession::due(double due_s) {
  const std::lock_guard lock(mutex_);
  if (ending_ || !held_) return;
  if (due_s >= plan_.counted_from_s) tally_.lateness.add(now_s() - due_s);
  intend(due_s);
  send_newest();
}

void LoadSession::end(End how) {
  {
    const std::lock_guard lock(mutex_);
    const bool drop = how == End::kDropped;
    if (!ending_ && !done_ && held_ && !drop && !writing_) StartWritesDone();
    if (!ending_ && !done_ && how != End::kServed) {
      tally_.intended -= unanswered_.count(plan_.counted_from_s);
      unanswered_ = {};
      newest_.reset();
    }
    ending_ = true;
    if (drop && !done_) cancelled_ = true, context_.TryCancel();
  }
  let_go();
}

Tally LoadSession::finish(Clock::time_point limit) {
  std::unique_lock lock(mutex_);
  if (!changed_.wait_until(lock, limit, [&] { return done_; })) cut_ = true, context_.TryCancel();
  changed_.wait(lock, [&] { return done_; });
  return tally_;
}

bool LoadSession::ended() {
  const std::lock_guard lock(mutex_);
  return done_;
}

void LoadSession::let_go() {
  bool held = false;
  {
    const std::lock_guard lock(mutex_);
    held = std::exchange(held_, false);
  }
  if (held) RemoveHold();
}

void LoadSession::OnWriteDone(bool ok) {
  const std::lock_guard lock(mutex_);
  writing_ = false;
  if (!ok || cancelled_) return;
  if (ending_)
    StartWritesDone();
  else
    send_newest();
}

void LoadSession::OnReadDone(bool ok) {
  if (!ok) return let_go();
  const std::lock_guard lock(mutex_);
  if (response_.has_opened()) {
    opened_ = true, ++tally_.opened;
    tally_.opening.add(now_s() - called_s_);
    period_s_ = response_.opened().period_s();
    intend_next();
  } else if (response_.has_answer()) {
    const v1::TouchAnswer& answer = response_.answer();
    acknowledged_ = answer.answer();
    if (answer.period_s() > 0) period_s_ = answer.period_s();  // an older service does not say
    ++tally_.answers;
    tally_.without_force +=
        answer.status() != v1::TOUCH_STATUS_OK && answer.status() != v1::TOUCH_STATUS_DEGRADED;
    tally_.counted_answers +=
        unanswered_.answered(answer.sequence(), now_s(), plan_.counted_from_s, tally_.latency) > 0;
    while (!sent_.empty() && sent_.front() <= answer.sequence()) sent_.pop_front();
    intend_next();
  } else if (response_.has_law()) {
    laws_acknowledged_ = response_.law().piece();
    ++tally_.laws;
  }
  send_newest();
  StartRead(&response_);
}

void LoadSession::OnDone(const grpc::Status& status) {
  const std::lock_guard lock(mutex_);
  tally_.unanswered += unanswered_.count(plan_.counted_from_s);
  if (cut_)
    ++tally_.failed["did not end"];
  else if (cancelled_)
    ++tally_.cancelled;
  else if (!status.ok())
    ++(opened_ ? tally_.failed : tally_.refused)[name_of(status.error_code())];
  if (!opened_ && !cut_ && !cancelled_ && !status.ok()) tally_.refusing.add(now_s() - called_s_);
  done_ = true;
  changed_.notify_all();
}

}  // namespace teletact::bench
