#include "service/scene/finger.h"

namespace teletact::service {

void FingerBoard::change() {
  finger_.present = streams_ > 0;
  ++finger_.generation;
  changed_.notify_all();
}

void FingerBoard::attach() {
  const std::lock_guard lock(mutex_);
  ++streams_;
  change();
}

void FingerBoard::detach() {
  const std::lock_guard lock(mutex_);
  --streams_;
  change();
}

void FingerBoard::arrive(const std::array<double, 3>& position_m, const std::array<double, 3>& velocity_m_s,
                         std::int64_t stamp_ns) {
  const std::lock_guard lock(mutex_);
  finger_.position_m = position_m;
  finger_.velocity_m_s = velocity_m_s;
  finger_.stamp_ns = stamp_ns;
  change();
}

Finger FingerBoard::now() const {
  const std::lock_guard lock(mutex_);
  return finger_;
}

Finger FingerBoard::newer_than(std::uint64_t generation, Clock::time_point deadline) const {
  std::unique_lock lock(mutex_);
  const std::uint64_t wakes = wakes_;
  changed_.wait_until(lock, deadline, [&] { return finger_.generation != generation || wakes_ != wakes; });
  return finger_;
}

void FingerBoard::wake() {
  const std::lock_guard lock(mutex_);
  ++wakes_;
  changed_.notify_all();
}

}  // namespace teletact::service
