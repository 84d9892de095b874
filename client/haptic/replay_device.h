// A recorded motion as a device: what a hand did once, done again, whatever is felt now. The force written is
// not felt by anyone.
//
// The motion starts when force is first on, and is not held back at the border of what is covered.
#pragma once

#include <atomic>
#include <vector>

#include "client/haptic/haptic_device.h"

namespace teletact::client {

struct MotionPoint {
  double time_s = 0;
  ToolPose pose;
};

class ReplayDevice final : public HapticDevice {
 public:
  // `motion`: times increasing, at least two points, the first out of contact (else no force is ever given).
  // Throws std::invalid_argument.
  ReplayDevice(DeviceProfile profile, std::vector<MotionPoint> motion);
  const DeviceProfile& profile() const noexcept override { return profile_; }
  void open() override;
  void close() noexcept override { open_ = false; }
  bool read(std::int64_t now_ns, DeviceReading& reading) noexcept override;
  bool write(const Vector3& force_n) noexcept override;
  void show(const OperatorView& view) noexcept override { view_ = view; }
  bool ended() const noexcept override { return ended_.load(std::memory_order_relaxed); }

 private:
  DeviceProfile profile_;
  std::vector<MotionPoint> motion_;
  OperatorView view_;
  std::size_t next_ = 1;       // the point ahead
  unsigned asking_reads_ = 0;  // reads since it began to ask for force
  std::int64_t begin_ns_ = 0;
  bool open_ = false, moving_ = false;
  std::atomic<bool> ended_{false};
};

}  // namespace teletact::client
