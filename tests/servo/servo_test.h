// A servo loop on a clock that moves when told to, with a device that the test holds and answers of analytic
// tissue.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <optional>

#include "client/haptic/haptic_device.h"
#include "client/render/kalman_renderer.h"
#include "client/servo/servo_loop.h"
#include "tests/render/analytic_tissue.h"

namespace teletact::client::test {

// A device that stands where the test puts it and keeps the force it was given.
class StillDevice final : public HapticDevice {
 public:
  const DeviceProfile& profile() const noexcept override { return device_profile("premium-1.5"); }
  void open() override {}
  void close() noexcept override {}
  bool read(std::int64_t, DeviceReading& out) noexcept override {
    out = reading;
    return ok;
  }
  bool write(const Vector3& force_n) noexcept override {
    force = force_n;
    return ok && takes_force;
  }
  DeviceReading reading;
  Vector3 force = Vector3::Zero();
  bool ok = true, takes_force = true;
};

// What WorkspaceDevice owns; a fixture keeps the device itself.
class Borrowed final : public HapticDevice {
 public:
  explicit Borrowed(HapticDevice& device) : device_(device) {}
  const DeviceProfile& profile() const noexcept override { return device_.profile(); }
  void open() override {}
  void close() noexcept override {}
  bool read(std::int64_t now_ns, DeviceReading& out) noexcept override { return device_.read(now_ns, out); }
  bool write(const Vector3& force_n) noexcept override { return device_.write(force_n); }
  std::optional<Vector3> workspace_centre_m() const noexcept override { return Vector3(0.1, 0, 0); }

 private:
  HapticDevice& device_;
};

class ServoTest : public ::testing::Test {
 protected:
  ServoTest() {
    options.chain.limits = device.profile().limits();
    servo = std::make_unique<ServoLoop>(device, renderer, clock, options);
  }

  virtual Vector3 finger_m() const { return device.reading.pose.position_m; }
  void put_finger(double y_m) { device.reading.pose.position_m = Vector3(0.02, y_m, 0); }

  // Ticks for so long; answers every 3 ms unless silent.
  void run(double seconds) {
    for (int n = 0; n < seconds * 1000 - 0.5; ++n) {
      clock.time_ns += 1'000'000;
      if (!silent && n % 3 == 0) {
        ServoAnswer answer;
        const double now_s = 1e-9 * static_cast<double>(clock.time_ns);
        answer.sample = tissue.told(finger_m(), now_s, ++sequence);
        answer.sample.model_version = version;
        answer.received_ns = clock.time_ns;
        answer.covered = true;
        answer.region.end_x_m = 0.1;
        answer.period_s = 0.002;
        answer.degraded = service_degraded;
        answer.has_force = has_force;
        servo->answers().put(answer);
      }
      servo->tick(clock.time_ns);
      ServoTick tick;
      while (servo->telemetry().pop(tick)) {
        largest_step_n = std::max(largest_step_n, (tick.force_n - last.force_n).norm());
        last = tick;
      }
    }
  }

  void enable() {
    put_finger(-0.003);
    run(0.05);
    servo->request_resume();
    run(0.002);
    ASSERT_EQ(last.state, ServoState::kEnabled);
  }

  ServoOptions options;
  StillDevice device;
  ManualClock clock;
  KalmanRenderer renderer;
  AnalyticTissue tissue;
  std::unique_ptr<ServoLoop> servo;
  bool silent = false;
  bool service_degraded = false;  // the service's status
  bool has_force = true;          // it could compute one
  std::uint64_t sequence = 0, version = 0;
  ServoTick last;
  double largest_step_n = 0;
};

}  // namespace teletact::client::test
