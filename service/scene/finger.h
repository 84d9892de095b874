// Where the finger is on a scene: touch streams bring it, the patient side watches it (WatchFinger).
#pragma once

#include <array>
#include <cstdint>
#include <mutex>

namespace teletact::service {

struct Finger {
  bool present = false;  // a touch stream is open
  std::array<double, 3> position_m{}, velocity_m_s{};
  std::int64_t stamp_ns = 0;     // CLOCK_MONOTONIC when the pose arrived; 0 = no pose yet
  std::uint64_t generation = 0;  // counts changes
};

class FingerBoard {
 public:
  void attach();  // a touch stream opened
  void detach();  // ... and ended
  void arrive(const std::array<double, 3>& position_m, const std::array<double, 3>& velocity_m_s,
              std::int64_t stamp_ns);
  Finger now() const;

 private:
  void change();
  mutable std::mutex mutex_;
  Finger finger_;
  std::uint64_t streams_ = 0;
};

}  // namespace teletact::service
