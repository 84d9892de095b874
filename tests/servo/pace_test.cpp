// When the loop ticks: on its phase whatever holds it up, each tick once.
#include <gtest/gtest.h>

#include <atomic>
#include <vector>

#include "tests/servo/servo_test.h"

namespace teletact::client {
namespace {

constexpr std::int64_t kPeriodNs = 1'000'000;

// Notes when it is read; holds the loop up at one of its reads, and stops it at another.
class HeldUpDevice final : public HapticDevice {
 public:
  HeldUpDevice(ManualClock& clock, std::atomic<bool>& stop) : clock_(clock), stop_(stop) {}
  const DeviceProfile& profile() const noexcept override { return device_profile("premium-1.5"); }
  void open() override {}
  void close() noexcept override {}
  bool read(std::int64_t now_ns, DeviceReading& reading) noexcept override {
    read_ns.push_back(now_ns);
    if (read_ns.size() == held_at) clock_.time_ns += held_ns;
    if (read_ns.size() == stopped_at) stop_ = true;
    reading.pose.position_m = {0.02, -0.003, 0};
    return true;
  }
  bool write(const Vector3&) noexcept override { return true; }
  std::vector<std::int64_t> read_ns;
  std::size_t held_at = 0, stopped_at = 20;
  std::int64_t held_ns = 0;

 private:
  ManualClock& clock_;
  std::atomic<bool>& stop_;
};

struct Paced {
  std::atomic<bool> stop{false};
  ManualClock clock;
  HeldUpDevice device{clock, stop};
  KalmanRenderer renderer;
  std::int64_t begin_ns = clock.time_ns;
  std::unique_ptr<ServoLoop> servo = std::make_unique<ServoLoop>(device, renderer, clock, ServoOptions());
};

TEST(Pace, DoesNotMakeUpForPastTicks) {
  for (const std::int64_t held_ns : {300'000, 1'500'000, 50'300'000}) {
    Paced paced;
    paced.device.held_at = 5;
    paced.device.held_ns = held_ns;
    paced.servo->run(paced.stop);
    const auto& read_ns = paced.device.read_ns;
    ASSERT_EQ(read_ns.size(), 20u);
    EXPECT_EQ(paced.servo->ticks(), 20u);
    for (std::size_t n = 1; n < read_ns.size(); ++n) {
      const std::int64_t step_ns = read_ns[n] - read_ns[n - 1];
      EXPECT_EQ((read_ns[n] - paced.begin_ns) % kPeriodNs, 0) << n;
      EXPECT_EQ(step_ns, n == 5 ? (held_ns / kPeriodNs + 1) * kPeriodNs : kPeriodNs) << n;
    }
    EXPECT_EQ(paced.servo->overruns(), 0u);
  }
}

TEST(Pace, CountsLateWakeUpsAndKeepsThePhase) {
  Paced paced;
  paced.clock.wake_late_ns = 1'500'000;
  paced.servo->run(paced.stop);
  EXPECT_EQ(paced.servo->ticks(), 20u);
  EXPECT_EQ(paced.servo->overruns(), 20u);
  for (std::size_t n = 1; n < 20; ++n)
    EXPECT_EQ(paced.device.read_ns[n] - paced.device.read_ns[n - 1], 2 * kPeriodNs);
}

}  // namespace
}  // namespace teletact::client
