#include "service/touch_plane/touch_stream.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "service/limits/seconds.h"
#include "service/plan/choices.h"
#include "service/scene/errors.h"

namespace teletact::service {

namespace {

constexpr std::chrono::minutes kLook{1};  // whoever ends the stream wakes it
constexpr unsigned kMostPieces = 2;       // of laws, between two answers: they wait for no more
constexpr std::chrono::milliseconds kLookForLaw{1};

std::uint64_t credit_from(std::uint64_t wished, const Limits& limits) {
  if (wished > TouchStream::kMostCredit)
    throw std::invalid_argument(
        fmt::format("open.credit: {} is more than {}; ask for fewer answers in flight", wished,
                    TouchStream::kMostCredit));
  return std::clamp<std::uint64_t>(wished, 1, limits.most_credit);
}

TouchStream::Clock::duration period_from(double wished_s, const Limits& limits) {
  if (wished_s == 0) wished_s = TouchStream::kUsualPeriodS;
  if (!(wished_s > 0 && wished_s <= limits.most_touch_period_s))
    throw std::invalid_argument(fmt::format("open.period_s: {} is not within (0, {}]; leave it out for {} s",
                                            wished_s, limits.most_touch_period_s,
                                            TouchStream::kUsualPeriodS));
  return seconds(std::max(wished_s, 1 / limits.most_touch_rate_hz));
}

Along along(const Vector3& vector) {
  return {vector[0], vector[2]};
}

TouchOptions&& options_of(TouchWishes& wishes) {
  if (wishes.session_id.size() > TouchStream::kMostSessionIdBytes)
    throw std::invalid_argument(fmt::format("open.session_id: {} bytes; choose a name of at most {}",
                                            wishes.session_id.size(), TouchStream::kMostSessionIdBytes));
  wishes.touch.pressure = wishes.pressure || wishes.tactile;
  return std::move(wishes.touch);
}

}  // namespace

TouchStream::TouchStream(std::shared_ptr<Scene> scene, TouchWishes wishes, const CurrentDevice& device)
    : scene_(std::move(scene)),
      device_(device),
      credit_(credit_from(wishes.credit, scene_->limits())),
      period_(period_from(wishes.period_s, scene_->limits())),
      pressure_(wishes.pressure),
      session_(scene_, options_of(wishes), device),
      laws_(wishes.laws ? std::make_optional<LawOutbox>() : std::nullopt),
      tactile_(wishes.tactile ? std::make_optional<TactileOutbox>(*wishes.tactile) : std::nullopt),
      finger_(scene_->finger().join(wishes.session_id, Clock::now(), session_.tolerance(),
                                    wishes.may_steer)) {}  // last: one that is refused never was

Region TouchStream::covered() const {
  return scene_->snapshot()->covered_around(scene_->finger().now().position_m[0]);
}

FingerBoard::Steering TouchStream::steering() {
  return scene_->finger().steering(finger_, Clock::now());
}

bool TouchStream::bring(const FingerPose& pose) {
  const auto arrived = Clock::now();
  if (pose.sequence <= last_sequence_)
    throw std::invalid_argument(
        fmt::format("pose.sequence: {} after {}; count up from 1", pose.sequence, last_sequence_));
  if (pose.acknowledged > answered_ || pose.acknowledged < acknowledged_)
    throw std::invalid_argument(fmt::format(
        "pose.acknowledged: {}, but {} answers were sent and {} acknowledged; give the number of the "
        "newest answer received",
        pose.acknowledged, answered_.load(), acknowledged_.load()));
  if (laws_) laws_->acknowledge(pose.laws_acknowledged);
  // Whoever is silent may be idle; whoever sends poses has had the time to read.
  const double patience_s = scene_->limits().acknowledge_s;
  if (pose.acknowledged > acknowledged_)
    owed_ = arrived;
  else if (acknowledged_ < answered_ && arrived - owed_.load() > seconds(patience_s))
    throw Error(ErrorKind::kDeadline,
                fmt::format("pose.acknowledged: still {} after {} s, {} answers were sent; acknowledge the "
                            "newest answer with each pose, or open a new stream",
                            acknowledged_.load(), patience_s, answered_.load()));
  last_sequence_ = pose.sequence;
  heard_ = arrived;
  scene_->finger().arrive(finger_, pose.position_m, pose.velocity_m_s, arrived);
  ++poses_;
  const bool replaced = inbox_.put({pose, arrived});
  replaced_ += replaced;
  // After the pose: what it makes room for is its own answer, not an older one's.
  if (acknowledged_.exchange(pose.acknowledged) != pose.acknowledged) inbox_.wake();
  return replaced;
}

void TouchStream::hand_over(const std::string& session_id) {
  scene_->finger().hand_over(finger_, session_id, Clock::now());
}

std::optional<TouchStream::Arrived> TouchStream::next(const std::function<bool()>& may_answer,
                                                      const std::function<bool()>& stopped) {
  inbox_.wait(due_, stopped);  // keep the period; poses that come meanwhile replace each other
  const auto now = Clock::now();
  const bool looks_soon = laws_ && pieces_ < kMostPieces && laws_->expects_more(now);
  auto pose = inbox_.take(
      now + (looks_soon ? Clock::duration(choices::kLawStep) : kLook),
      [&] { return may_answer() && answered_ - acknowledged_ < credit_; }, stopped);
  // A late pose is caught up with over one period, no more.
  if (pose) due_ = std::max(due_, Clock::now() - period_) + period_;
  return pose;
}

TouchStream::Answered TouchStream::answer(const Arrived& arrived) {
  const auto begun = Clock::now();
  const std::shared_ptr<Device> device = device_;
  session_.use(device);
  const auto may_enter = [&](const WindowModel& window) {
    return this->may_enter(window, arrived.pose.position_m);
  };
  Answered answered{session_.solve(arrived.pose.position_m, may_enter), 0, begun - arrived.at, {}, {}};
  answered.computing = Clock::now() - begun;
  if (tactile_) {
    session_.show(*tactile_, arrived.pose.sequence, arrived.pose.position_m, answered.answer);
    answered.tactile = tactile_->take();
  }
  if (!pressure_) answered.answer.contact.pressure.clear();
  scene_->finger().wish(finger_, answered.answer.wish);
  finger_at_ = arrived.pose;
  pieces_ = 0;
  if (answered.answer.device_failed) device_.failed(device, answered.answer.warning);
  answered.steering = steering();
  if (acknowledged_ == answered_) owed_ = Clock::now();
  answered.number = ++answered_;  // before it is sent: its acknowledgement may be quicker than we are
  return answered;
}

void TouchStream::look_ahead() {
  const std::shared_ptr<Device> device = device_;
  session_.use(device);
  try {
    session_.look_ahead();
  } catch (const DeviceError& error) {
    device_.failed(device, error.what());
  }
}

std::optional<LawPiece> TouchStream::piece_for(const FingerPose& finger, double farthest_m) {
  const Along place_m = along(finger.position_m);
  if (!laws_ || !std::isfinite(place_m.x) || !std::isfinite(place_m.z)) return std::nullopt;
  const auto law_of = [&](const WindowModel& window) { return session_.law_of(window, finger.position_m); };
  return laws_->next(*scene_->snapshot(), place_m, along(finger.velocity_m_s), law_of, farthest_m);
}

std::optional<LawPiece> TouchStream::law_before(const Arrived& arrived,
                                                const std::function<bool()>& stopped) {
  while (true) {
    auto piece = piece_for(arrived.pose, kLawNearM);
    const bool waits = laws_ && answered_ == 0 && Clock::now() < arrived.at + choices::kLawStep;
    if (piece || !waits || inbox_.wait(Clock::now() + kLookForLaw, stopped)) return piece;
  }
}

std::optional<LawPiece> TouchStream::next_law() {
  if (!finger_at_ || pieces_ == kMostPieces) return std::nullopt;
  auto piece = piece_for(*finger_at_, std::numeric_limits<double>::infinity());
  pieces_ += piece.has_value();
  return piece;
}

// Whoever feels a law is answered from its version until the next one's is told: an answer of a version
// without a law is felt a round trip late.
bool TouchStream::may_enter(const WindowModel& window, const Vector3& position_m) {
  const auto now = Clock::now();
  const bool waits = laws_ && laws_->owes(window, along(position_m)) &&
                     now - awaited_since_.value_or(now) < choices::kLawExpected;
  if (!waits)
    awaited_since_.reset();
  else if (!awaited_since_)
    awaited_since_ = now;
  return !waits;
}

void TouchStream::wait(const std::function<bool()>& may_write, const std::function<bool()>& stopped) {
  while (!inbox_.wait(Clock::now() + kLook, [&] { return stopped() || may_write(); })) {
  }
}

void TouchStream::leave() {
  scene_->finger().leave(finger_, Clock::now());
}

void TouchStream::require_poses(Clock::time_point now) const {
  if (now - heard_.load() > seconds(scene_->limits().touch_idle_s))
    throw Error(ErrorKind::kDeadline,
                fmt::format("no pose for {} s; open a new stream", scene_->limits().touch_idle_s));
}

}  // namespace teletact::service
