#include "service/touch_plane/touch_exchange.h"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

#include "service/base/choices.h"
#include "service/base/seconds.h"
#include "service/scene/errors.h"

namespace teletact::service {

TouchExchange::TouchExchange(const Terms& terms, Time now)
    : terms_(terms), period_(terms.period), law_due_(Time::max()), due_(now), room_(now), heard_(now) {}

bool TouchExchange::pose(const FingerPose& pose, Time now) {
  if (pose.sequence <= last_sequence_)
    throw std::invalid_argument(
        fmt::format("pose.sequence: {} after {}; count up from 1", pose.sequence, last_sequence_));
  if (pose.acknowledged > answered_ || pose.acknowledged < acknowledged_)
    throw std::invalid_argument(fmt::format(
        "pose.acknowledged: {}, but {} answers were sent and {} acknowledged; give the number of the "
        "newest answer received",
        pose.acknowledged, answered_, acknowledged_));
  // Whoever is silent may be idle; whoever sends poses has had the time to read.
  if (pose.acknowledged > acknowledged_)
    owed_ = room_ = now;
  else if (acknowledged_ < answered_ && now - owed_ > seconds(terms_.acknowledge_s))
    throw Error(ErrorKind::kDeadline,
                fmt::format("pose.acknowledged: still {} after {} s, {} answers were sent; acknowledge the "
                            "newest answer with each pose, or open a new stream",
                            acknowledged_, terms_.acknowledge_s, answered_));
  acknowledged_ = pose.acknowledged;
  last_sequence_ = pose.sequence;
  heard_ = now;
  ++poses_;
  const bool replaced = inbox_.put({pose, now});
  replaced_ += replaced;
  return replaced;
}

void TouchExchange::require_poses(Time now) const {
  if (now - heard_ > seconds(terms_.idle_s))
    throw Error(ErrorKind::kDeadline, fmt::format("no pose for {} s; open a new stream", terms_.idle_s));
}

void TouchExchange::keep(Clock::duration period) {
  period_ = std::max(terms_.period, period);
}

TouchExchange::Next TouchExchange::next(Time now) const {
  constexpr Next kNone{Work::kNothing, Time::max()};
  if (busy_ || left_) return kNone;
  if (ended_) return {Work::kLeave, now};
  if (writing_) return kNone;
  if (!opened_) return {Work::kOpen, now};
  if (asked_) return {law_looked_for_ ? Work::kAnswer : Work::kLawBefore, law_looked_for_ ? now : law_due_};
  Next next = kNone;
  if (finger_at_ && pieces_ < kMaxPieces && law_due_ < Time::max()) next = {Work::kLaw, law_due_};
  if (!inbox_.newest() || answered_ - acknowledged_ >= terms_.credit) return next;
  // Poses that come before it is due replace each other.
  const Time due = std::max({due_, inbox_.newest()->at, room_});
  return next.due <= std::max(due, now) ? next : Next{Work::kAnswer, due};
}

TouchExchange::Work TouchExchange::begin(Time now) {
  if (left_) return Work::kLeave;
  const Next next = this->next(now);
  if (next.due > now) return Work::kNothing;
  busy_ = true;
  if (next.work == Work::kOpen) opened_ = true;
  if (next.work == Work::kLeave) left_ = true;
  if (next.work != Work::kAnswer || asked_) return next.work;
  // A late pose is caught up with over one period, no more.
  due_ = std::max(due_, now - period_) + period_;
  asked_ = inbox_.take();
  law_looked_for_ = !terms_.laws;
  return law_looked_for_ ? Work::kAnswer : Work::kLawBefore;
}

void TouchExchange::law_sent(Time now, bool sent, bool more) {
  busy_ = false;
  writing_ = sent;
  if (asked_) {
    // Nothing is felt before the first answer: that one waits for a law which is being made.
    const bool waits = answered_ == 0 && now < asked_->at + choices::kLawStep;
    law_looked_for_ = !sent && !waits;
    law_due_ = sent ? now : now + kLookForLaw;
    return;
  }
  pieces_ += sent;
  law_due_ = sent ? now : more ? now + choices::kLawStep : Time::max();
}

std::uint64_t TouchExchange::answered(Time now, bool more) {
  finger_at_ = asked_->pose;
  asked_.reset();
  pieces_ = 0;
  law_due_ = more ? now : Time::max();
  if (acknowledged_ == answered_) owed_ = now;
  did_write();
  return ++answered_;
}

}  // namespace teletact::service
