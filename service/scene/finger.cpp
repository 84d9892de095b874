#include "service/scene/finger.h"

namespace teletact::service {

void FingerBoard::change() {
  finger_.present = streams_ > 0;
  ++finger_.generation;
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

}  // namespace teletact::service
