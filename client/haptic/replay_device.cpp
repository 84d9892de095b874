#include "client/haptic/replay_device.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "client/clock/clock.h"

namespace teletact::client {

ReplayDevice::ReplayDevice(DeviceProfile profile, std::vector<MotionPoint> motion)
    : profile_(std::move(profile)), motion_(std::move(motion)) {
  if (motion_.size() < 2) throw std::invalid_argument("a recorded motion needs at least two points");
  for (std::size_t k = 0; k < motion_.size(); ++k) {
    const MotionPoint& point = motion_[k];
    if (!point.pose.position_m.allFinite() || !point.pose.velocity_m_s.allFinite() ||
        (k > 0 && !(point.time_s > motion_[k - 1].time_s)))
      throw std::invalid_argument("a recorded motion needs finite positions and increasing times; point " +
                                  std::to_string(k) + " is not so");
  }
}

void ReplayDevice::open() {
  next_ = 1;
  asking_reads_ = 0;
  moving_ = false;
  ended_ = false;
  open_ = true;
}

bool ReplayDevice::read(std::int64_t now_ns, DeviceReading& reading) noexcept {
  if (!open_) return false;
  if (view_.force_on && !moving_) {
    moving_ = true;
    begin_ns_ = now_ns;
  }
  const double elapsed_s = moving_ ? seconds(now_ns - begin_ns_) : 0;
  const double time_s = motion_.front().time_s + elapsed_s;
  while (next_ + 1 < motion_.size() && motion_[next_].time_s <= time_s) ++next_;
  const MotionPoint &from = motion_[next_ - 1], &to = motion_[next_];
  const double share = std::clamp((time_s - from.time_s) / (to.time_s - from.time_s), 0.0, 1.0);
  reading.pose.position_m = from.pose.position_m + share * (to.pose.position_m - from.pose.position_m);
  reading.pose.velocity_m_s =
      from.pose.velocity_m_s + share * (to.pose.velocity_m_s - from.pose.velocity_m_s);
  const bool over = time_s >= motion_.back().time_s;
  if (over || !moving_) reading.pose.velocity_m_s.setZero();
  if (over) ended_.store(true, std::memory_order_relaxed);
  reading.held_at_border = false;
  // The button is pressed and released until it has been heard.
  constexpr unsigned kPressReads = 50;
  const bool asks = !view_.force_on && view_.link_alive;
  reading.resume_pressed = asks && asking_reads_ % (2 * kPressReads) < kPressReads;
  asking_reads_ = asks ? asking_reads_ + 1 : 0;
  return true;
}

bool ReplayDevice::write(const Vector3& force_n) noexcept {
  return open_ && force_n.allFinite();
}

}  // namespace teletact::client
