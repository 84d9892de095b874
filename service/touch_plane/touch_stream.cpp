#include "service/touch_plane/touch_stream.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "service/base/choices.h"
#include "service/base/seconds.h"
#include "service/scene/errors.h"

namespace teletact::service {

namespace {

std::uint64_t credit_from(std::uint64_t wished, const Limits& limits) {
  if (wished > TouchStream::kMaxCredit)
    throw std::invalid_argument(fmt::format(
        "open.credit: {} is more than {}; ask for fewer answers in flight", wished, TouchStream::kMaxCredit));
  return std::clamp<std::uint64_t>(wished, 1, limits.max_credit);
}

TouchStream::Clock::duration answer_period(double wished_s, const Limits& limits) {
  if (wished_s == 0) wished_s = TouchStream::kUsualPeriodS;
  if (!(wished_s > 0 && wished_s <= limits.max_touch_period_s))
    throw std::invalid_argument(fmt::format("open.period_s: {} is not within (0, {}]; leave it out for {} s",
                                            wished_s, limits.max_touch_period_s, TouchStream::kUsualPeriodS));
  return seconds(std::max(wished_s, 1 / limits.max_touch_rate_hz));
}

Along along(const Vector3& vector) {
  return {vector[0], vector[2]};
}

TouchExchange::Terms terms_from(const TouchStreamOptions& options, const Limits& limits) {
  return {credit_from(options.credit, limits), answer_period(options.period_s, limits), options.laws,
          limits.acknowledge_s, limits.touch_idle_s};
}

TouchOptions&& options_of(TouchStreamOptions& options) {
  if (options.session_id.size() > TouchStream::kMaxSessionIdBytes)
    throw std::invalid_argument(fmt::format("open.session_id: {} bytes; choose a name of at most {}",
                                            options.session_id.size(), TouchStream::kMaxSessionIdBytes));
  options.touch.pressure = options.pressure || options.tactile;
  return std::move(options.touch);
}

}  // namespace

TouchStream::TouchStream(std::shared_ptr<Scene> scene, TouchStreamOptions options,
                         const CurrentDevice& device)
    : scene_(std::move(scene)),
      device_(device),
      exchange_(terms_from(options, scene_->limits()), Clock::now()),
      pressure_(options.pressure),
      session_id_(options.session_id),
      session_(scene_, options_of(options), device),
      laws_(options.laws ? std::make_optional<LawOutbox>() : std::nullopt),
      tactile_(options.tactile ? std::make_optional<TactileOutbox>(*options.tactile) : std::nullopt),
      finger_(scene_->finger().join(options.session_id, Clock::now(), session_.tolerance(),
                                    options.may_steer)) {}  // last: one that is refused never was

Region TouchStream::covered() const {
  return scene_->snapshot()->covered_around(scene_->finger().now().position_m[0]);
}

FingerBoard::Steering TouchStream::steering() {
  return scene_->finger().steering(finger_, Clock::now());
}

bool TouchStream::bring(const FingerPose& pose) {
  const auto arrived = Clock::now();
  const std::lock_guard lock(mutex_);
  if (laws_) laws_->acknowledge(pose.laws_acknowledged);
  const bool replaced = exchange_.pose(pose, arrived);
  scene_->finger().arrive(finger_, pose.position_m, pose.velocity_m_s, arrived);
  return replaced;
}

void TouchStream::hand_over(const std::string& session_id) {
  scene_->finger().hand_over(finger_, session_id, Clock::now());
}

TouchStream::Said TouchStream::turn(Clock::duration period) try {
  using Work = TouchExchange::Work;
  Work work = Work::kNothing;
  {
    const std::lock_guard lock(mutex_);
    due_ = Clock::time_point::max();
    exchange_.keep(period);
    work = exchange_.begin(Clock::now());
  }
  switch (work) {
    case Work::kNothing:
      break;
    case Work::kOpen: {
      const std::lock_guard lock(mutex_);
      exchange_.opened();
      return Opened{exchange_.period()};
    }
    case Work::kLawBefore:
    case Work::kLaw:
      if (auto piece = law_for(work)) return *std::move(piece);
      return turn(period);
    case Work::kAnswer:
      return answer();
    case Work::kLeave:
      leave();
      return Left{};
  }
  return {};
} catch (...) {
  const std::lock_guard lock(mutex_);
  exchange_.failed();
  throw;
}

TouchStream::Answered TouchStream::answer() {
  const auto begun = Clock::now();
  const Arrived& asked = exchange_.asked();  // nobody changes it before answered()
  const FingerPose& pose = asked.pose;
  const std::shared_ptr<Device> device = device_;
  session_.use(device);
  const auto may_enter = [&](const WindowModel& window) { return this->may_enter(window, pose.position_m); };
  Answered answered{asked, {}, session_.solve(pose.position_m, may_enter), 0, begun - asked.at, {}, {}};
  answered.computing = Clock::now() - begun;
  if (tactile_) {
    session_.show(*tactile_, pose.sequence, pose.position_m, answered.answer);
    answered.tactile = tactile_->take();
  }
  if (!pressure_) answered.answer.contact.pressure.clear();
  scene_->finger().wish(finger_, answered.answer.wish);
  if (answered.answer.device_failed) device_.failed(device, answered.answer.warning);
  answered.steering = steering();
  const auto now = Clock::now();
  {
    const std::lock_guard lock(mutex_);
    answered.period = exchange_.period();
    answered.number =
        exchange_.answered(now, more_laws(now));  // its acknowledgement may be quicker than we are
  }
  if (scene_->observers()->any()) tell_observers(answered);
  return answered;
}

// Beside the answer, which waits for none of it.
void TouchStream::tell_observers(const Answered& answered) {
  const auto now = Clock::now();
  const FingerPose& pose = answered.asked.pose;
  const Observers::From from{session_id_, answered.steering.steers};
  const auto wanted = scene_->observers()->wanted(from);
  if (wanted.touch) {
    auto touch = std::make_shared<ObservedTouch>(ObservedTouch{answered, now});
    touch->answered.answer.contact.pressure.clear();
    touch->answered.tactile.reset();
    scene_->observers()->tell(from, touch);
  }
  surface_told_ = surface_told_ || wanted.surface;
  if (wanted.surface)
    session_.deform(surface_, {pose.sequence, answered.asked.at, layer().depth_m, {}, {}}, pose.position_m,
                    answered.answer,
                    [observers = scene_->observers(), session = session_id_,
                     steers = from.steers](const std::shared_ptr<const ObservedSurface>& surface) {
                      observers->tell({session, steers}, surface);
                    });
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

std::optional<LawPiece> TouchStream::law_for(TouchExchange::Work work) {
  const bool before = work == TouchExchange::Work::kLawBefore;
  auto piece = before ? piece_for(exchange_.asked().pose, kLawNearM)
                      : piece_for(*exchange_.finger(), std::numeric_limits<double>::infinity());
  const auto now = Clock::now();
  const std::lock_guard lock(mutex_);
  exchange_.law_sent(now, piece.has_value(), more_laws(now));
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

void TouchStream::leave() {
  // The layer that it pressed in rests for those who look on.
  if (std::exchange(surface_told_, false))
    scene_->observers()->tell(
        {session_id_, steering().steers},
        std::make_shared<const ObservedSurface>(ObservedSurface{0, Clock::now(), layer().depth_m, {}, {}}));
  scene_->finger().leave(finger_, Clock::now());
}

void TouchStream::written() {
  const std::lock_guard lock(mutex_);
  exchange_.written();
}

void TouchStream::end() {
  const std::lock_guard lock(mutex_);
  exchange_.end();
}

TouchStream::Clock::time_point TouchStream::due() {
  const std::lock_guard lock(mutex_);
  const auto due = exchange_.next(Clock::now()).due;
  if (due >= due_) return Clock::time_point::max();
  return due_ = due;
}

void TouchStream::require_poses(Clock::time_point now) const {
  const std::lock_guard lock(mutex_);
  exchange_.require_poses(now);
}

TouchExchange::Counts TouchStream::counts() const {
  const std::lock_guard lock(mutex_);
  return exchange_.counts();
}

}  // namespace teletact::service
