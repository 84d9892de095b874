#include "client/acquire/finger_watch.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "client/clock/clock.h"
#include "client/link/channel.h"
#include "client/link/retry.h"
#include "client/link/scenes.h"

namespace teletact::client {
namespace {
constexpr auto kReconnectAfter = std::chrono::milliseconds(100);
constexpr double kExtrapolateAtMostS = 0.1;
}  // namespace

FingerWatch::FingerWatch(std::string address, Credentials credentials, std::string scene_id, int axis,
                         double dead_s)
    : address_(std::move(address)),
      scene_id_(std::move(scene_id)),
      credentials_(std::move(credentials)),
      axis_(axis),
      dead_s_(dead_s),
      thread_([this] { follow(); }),
      guard_([this] { end_dead_streams(); }) {}

FingerWatch::~FingerWatch() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
    if (context_) context_->TryCancel();
    stopped_.notify_all();
  }
  thread_.join();
  guard_.join();
}

FingerMotion FingerWatch::motion(std::int64_t now_ns) const {
  const std::lock_guard lock(mutex_);
  FingerMotion motion = newest_;
  if (motion.present) {
    const double age_s = std::clamp(seconds(now_ns - news_ns_), 0.0, kExtrapolateAtMostS);
    motion.x_m += motion.velocity_m_s * age_s;
  }
  return motion;
}

std::optional<v1::SliceWish> FingerWatch::wish() const {
  const std::lock_guard lock(mutex_);
  return wish_;
}

std::optional<std::int64_t> FingerWatch::gone_since_ns() const {
  const std::lock_guard lock(mutex_);
  return gone_since_ns_;
}

std::string FingerWatch::failure() const {
  const std::lock_guard lock(mutex_);
  return failure_;
}

void FingerWatch::follow() {
  while (read_stream()) std::this_thread::sleep_for(kReconnectAfter);
}

void FingerWatch::end_dead_streams() {
  constexpr auto kLookEvery = std::chrono::milliseconds(100);
  std::unique_lock lock(mutex_);
  while (!stopped_.wait_for(lock, kLookEvery, [this] { return stopping_; })) {
    const double silence_s = seconds(monotonic_ns() - arrived_ns_);
    if (context_ && silence_s > dead_s_) context_->TryCancel();  // ends the reader
  }
}

bool FingerWatch::read_stream() {
  const auto context = std::make_shared<grpc::ClientContext>();
  name_scene(*context, scene_id_);
  {
    const std::lock_guard lock(mutex_);
    if (stopping_) return false;
    context_ = context;
    arrived_ns_ = monotonic_ns();
  }
  v1::WatchFingerRequest request;
  request.set_scene_id(scene_id_);
  // A new connection each time: the old one may be half-open.
  const auto stub = v1::Palpation::NewStub(make_channel(address_, credentials_));
  const auto stream = stub->WatchFinger(context.get());
  for (v1::FingerState state; stream->Write(request) && stream->Read(&state);) {
    store(state);
    request.clear_scene_id();
    request.set_acknowledged(state.state());
  }
  const grpc::Status status = stream->Finish();
  const std::lock_guard lock(mutex_);
  context_.reset();
  // A finger that cannot be seen is not away: the session waits for the service to come back.
  newest_.velocity_m_s = 0;
  wish_.reset();
  if (stopping_) return false;
  const bool deleted = status.error_code() == grpc::StatusCode::ABORTED;  // the scene
  // The rest, a link, a service that restarts or has too many callers, may pass.
  if (!refused_for_good(status) && !deleted && status.error_code() != grpc::StatusCode::FAILED_PRECONDITION)
    return true;
  failure_ = "WatchFinger: " + describe(status);
  return false;
}

void FingerWatch::store(const v1::FingerState& state) {
  const std::int64_t now_ns = monotonic_ns();
  const std::lock_guard lock(mutex_);
  newest_.present = state.present();
  if (state.position_m_size() > axis_) newest_.x_m = state.position_m(axis_);
  newest_.velocity_m_s = state.velocity_m_s_size() > axis_ ? state.velocity_m_s(axis_) : 0;
  wish_ = state.has_wish() ? std::make_optional(state.wish()) : std::nullopt;
  arrived_ns_ = now_ns;
  if (state.stamp().monotonic_ns() != stamp_ns_) news_ns_ = now_ns;
  stamp_ns_ = state.stamp().monotonic_ns();
  seen_ = seen_ || state.present();
  if (state.present())
    gone_since_ns_.reset();
  else if (seen_ && !gone_since_ns_)
    gone_since_ns_ = now_ns;
}

}  // namespace teletact::client
