#include "service/scene/finger.h"

#include <algorithm>
#include <utility>

namespace teletact::service {

std::vector<FingerBoard::Member>::iterator FingerBoard::find(Stream stream) {
  return std::find_if(members_.begin(), members_.end(),
                      [stream](const Member& member) { return member.stream == stream; });
}

void FingerBoard::steer(const Member* member) {
  steers_ = member ? member->stream : 0;
  finger_.present = member != nullptr;
  finger_.session_id = member ? member->session_id : "";
  finger_.velocity_m_s = {};  // another hand's, or nobody's
  finger_.wish.reset();
  ++finger_.generation;
}

void FingerBoard::wait_behind(Stream stream) {
  const auto member = find(stream);
  std::rotate(member, member + 1, members_.end());
}

// Who steers by `now`.
void FingerBoard::settle(Clock::time_point now) {
  const auto heard = [now](const Member& member) { return member.may_steer && now - member.heard <= kLease; };
  if (steers_ != 0) {
    if (heard(*find(steers_))) return;
    wait_behind(steers_);
  }
  const auto next = std::find_if(members_.begin(), members_.end(), heard);
  if (next != members_.end())
    steer(&*next);
  else if (steers_ != 0)
    steer(nullptr);
}

FingerBoard::Stream FingerBoard::join(std::string session_id, Clock::time_point now, double tolerance,
                                      bool may_steer) {
  const std::lock_guard lock(mutex_);
  members_.push_back({++last_, std::move(session_id), now, tolerance, may_steer});
  settle(now);
  return last_;
}

void FingerBoard::leave(Stream stream, Clock::time_point now) {
  const std::lock_guard lock(mutex_);
  const auto member = find(stream);
  if (member == members_.end()) return;
  members_.erase(member);
  if (steers_ == stream) steer(nullptr);
  settle(now);
}

void FingerBoard::arrive(Stream stream, const std::array<double, 3>& position_m,
                         const std::array<double, 3>& velocity_m_s, Clock::time_point now) {
  const std::lock_guard lock(mutex_);
  settle(now);  // before: it may have been silent for too long itself
  const auto member = find(stream);
  if (member == members_.end()) return;
  member->heard = now;
  settle(now);
  if (steers_ != stream) return;
  finger_.position_m = position_m;
  finger_.velocity_m_s = velocity_m_s;
  finger_.stamp_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(now.time_since_epoch()).count();
  ++finger_.generation;
}

void FingerBoard::wish(Stream stream, const std::optional<SliceWish>& wish) {
  const std::lock_guard lock(mutex_);
  if (steers_ != stream || finger_.wish == wish) return;
  finger_.wish = wish;
  ++finger_.generation;
}

void FingerBoard::hand_over(Stream from, const std::string& session_id, Clock::time_point now) {
  const std::lock_guard lock(mutex_);
  settle(now);
  if (steers_ != from || session_id.empty()) return;
  const auto to = std::find_if(members_.begin(), members_.end(), [&](const Member& member) {
    return member.may_steer && member.stream != from && member.session_id == session_id;
  });
  if (to == members_.end()) return;
  to->heard = now;
  steer(&*to);
  wait_behind(from);
}

FingerBoard::Steering FingerBoard::steering(Stream stream, Clock::time_point now) {
  const std::lock_guard lock(mutex_);
  settle(now);
  return {steers_ == stream, finger_.session_id};
}

Finger FingerBoard::at(Clock::time_point now) {
  const std::lock_guard lock(mutex_);
  settle(now);
  return finger_;
}

double FingerBoard::tolerance() const {
  const std::lock_guard lock(mutex_);
  const auto least = std::ranges::min_element(members_, {}, &Member::tolerance);
  return least == members_.end() ? Tolerance{}.relative : least->tolerance;
}

Finger FingerBoard::now() const {
  const std::lock_guard lock(mutex_);
  return finger_;
}

}  // namespace teletact::service
