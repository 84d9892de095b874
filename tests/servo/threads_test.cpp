// The loop with all its threads, in real time: what ThreadSanitizer looks at.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <stdexcept>
#include <thread>
#include <vector>

#include "client/haptic/replay_device.h"
#include "client/haptic/simulated_device.h"
#include "client/render/kalman_renderer.h"
#include "client/servo/servo_thread.h"
#include "tests/render/analytic_tissue.h"

namespace teletact::client {
namespace {

// What the link does: the newest pose in, its answer out.
void answer_poses(ServoLoop& servo, Clock& clock, const std::atomic<bool>& stop) {
  const test::AnalyticTissue tissue;
  std::uint64_t sequence = 0;
  for (ServoPose pose; !stop; clock.sleep_until_ns(clock.now_ns() + 500'000)) {
    if (!servo.poses().take(pose)) continue;
    ServoAnswer answer;
    answer.sample = tissue.told(pose.pose.position_m, 1e-9 * static_cast<double>(pose.time_ns), ++sequence);
    answer.received_ns = clock.now_ns();
    answer.covered = true;
    answer.region.end_x_m = 0.12;
    answer.period_s = 0.002;
    servo.answers().put(answer);
  }
}

TEST(ServoThreads, LoopLinkTelemetryAndRequestsRunBesideEachOther) {
  SimulatedDeviceOptions device_options;
  device_options.profile = device_profile("premium-1.5");
  device_options.hand.begin_m = device_options.hand.start_m = 0.01;
  device_options.hand.end_m = 0.11;
  device_options.hand.approach_m_s = 0.1;
  SimulatedDevice device(device_options);
  device.open();
  KalmanRenderer renderer;
  MonotonicClock clock;
  ServoOptions options;
  options.chain.limits = device.profile().limits();
  const auto servo = std::make_unique<ServoLoop>(device, renderer, clock, options);
  std::atomic<bool> stop{false}, stop_link{false};
  std::thread loop([&] { servo->run(stop); });
  std::thread link([&] { answer_poses(*servo, clock, stop_link); });
  // The session's thread: telemetry, requests, and what a device may be asked from elsewhere.
  std::uint64_t seen = 0;
  double largest_n = 0;
  ServoTick tick;
  const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(900);
  while (std::chrono::steady_clock::now() < end) {
    while (servo->telemetry().pop(tick)) {
      ++seen;
      largest_n = std::max(largest_n, tick.force_n.norm());
    }
    servo->request_resume();
    EXPECT_LE(device.passes(), 1u);
    EXPECT_EQ(servo->rejected_answers(), 0u);
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  servo->request_pause();
  stop = true;
  loop.join();
  stop_link = true;
  link.join();
  while (servo->telemetry().pop(tick)) ++seen;
  EXPECT_EQ(seen + servo->telemetry().dropped(), servo->ticks());
  EXPECT_GT(largest_n, 0.1);
  EXPECT_EQ(tick.force_n.norm(), 0);
}

// The session asks from its own thread whether a motion is over, while the servo plays it.
TEST(ServoThreads, TheEndOfAMotionIsSeenFromAnotherThread) {
  std::vector<MotionPoint> motion(2);
  motion[0].pose.position_m = {0.02, -0.005, 0};
  motion[1].time_s = 0.2;
  motion[1].pose.position_m = {0.03, -0.005, 0};
  ReplayDevice device(device_profile("premium-1.5"), motion);
  device.open();
  KalmanRenderer renderer;
  MonotonicClock clock;
  const auto servo = std::make_unique<ServoLoop>(device, renderer, clock, ServoOptions());
  EXPECT_FALSE(device.ended());
  std::atomic<bool> stop{false}, stop_link{false};
  std::thread loop([&] { servo->run(stop); });
  std::thread link([&] { answer_poses(*servo, clock, stop_link); });
  double begun_s = -1, x_m = 0;
  ServoTick tick;
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(30);
  while (!device.ended() && std::chrono::steady_clock::now() < end) {
    while (servo->telemetry().pop(tick)) {
      x_m = tick.pose.position_m.x();
      if (begun_s < 0 && tick.state == ServoState::kEnabled)
        begun_s = 1e-9 * static_cast<double>(tick.time_ns);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_TRUE(device.ended());
  stop = true;  // the tick that saw the end may not have been told yet
  loop.join();
  stop_link = true;
  link.join();
  while (servo->telemetry().pop(tick)) x_m = tick.pose.position_m.x();
  EXPECT_GE(begun_s, 0);
  EXPECT_GE(1e-9 * static_cast<double>(tick.time_ns) - begun_s, 0.19) << "it ended before the motion did";
  EXPECT_NEAR(x_m, 0.03, 1e-9);
}

// Held out of the tissue until force is on, then pressed; keeps what was written. Read it when the loop is
// over.
class PressedDevice final : public HapticDevice {
 public:
  PressedDevice() { forces_n.reserve(20'000); }
  const DeviceProfile& profile() const noexcept override { return device_profile("premium-1.5"); }
  void open() override { opened = true; }
  void close() noexcept override {
    closed_with_n = forces_n.empty() ? 0 : forces_n.back().norm();
    opened = false;
  }
  bool read(std::int64_t, DeviceReading& reading) noexcept override {
    reading.pose.position_m = {0.02, force_on ? 0.004 : -0.003, 0};
    reading.resume_pressed = !force_on && ++reads_ % 100 >= 50;
    return true;
  }
  bool write(const Vector3& force_n) noexcept override {
    if (forces_n.size() < forces_n.capacity()) forces_n.push_back(force_n);
    return true;
  }
  void show(const OperatorView& view) noexcept override { force_on = view.force_on; }
  std::vector<Vector3> forces_n;
  bool opened = false, force_on = false;
  double closed_with_n = -1;

 private:
  unsigned reads_ = 0;
};

// A link or a recording may throw at any time: GIVEN a finger pressed with force on WHEN the scope is left by
// an exception THEN the force went down within the slew limit, and the device is closed after it.
TEST(ServoThreads, AnExceptionTakesTheForceDownInOrder) {
  PressedDevice device;
  KalmanRenderer renderer;
  MonotonicClock clock;
  ServoOptions options;
  options.chain.limits = device.profile().limits();
  const auto servo = std::make_unique<ServoLoop>(device, renderer, clock, options);
  std::atomic<bool> stop_link{false};
  std::thread link([&] { answer_poses(*servo, clock, stop_link); });
  double before_n = 0;
  const auto session = [&] {
    const OpenDevice open(device);
    ServoThread thread(*servo, {.real_time = false});
    ServoTick tick;
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(5);
    while (before_n < 0.5 && std::chrono::steady_clock::now() < end)
      while (servo->telemetry().pop(tick)) before_n = tick.force_n.norm();
    throw std::runtime_error("the disk is full");
  };
  EXPECT_THROW(session(), std::runtime_error);
  stop_link = true;
  link.join();
  EXPECT_GE(before_n, 0.5);
  EXPECT_FALSE(device.opened);
  EXPECT_EQ(device.closed_with_n, 0);
  ASSERT_GT(device.forces_n.size(), 100u);
  double largest_rise_n = 0;
  for (std::size_t n = 1; n < device.forces_n.size(); ++n)
    largest_rise_n = std::max(largest_rise_n, device.forces_n[n].norm() - device.forces_n[n - 1].norm());
  // The finger's jump into the tissue lets the force rise too; the ramp has hardly begun then.
  EXPECT_LE(largest_rise_n, options.chain.limits.largest_slew_n_s * options.chain.longest_dt_s * (1 + 1e-9));
}

// GIVEN an adapter that does not return, from its first call on or later WHEN the thread is stopped, or its
// scope left THEN the process ends and says why.
TEST(ServoThreads, ALoopThatCannotBeJoinedEndsTheProcess) {
  class BlockedDevice final : public HapticDevice {
   public:
    explicit BlockedDevice(unsigned reads) : reads_(reads) {}
    const DeviceProfile& profile() const noexcept override { return device_profile("premium-1.5"); }
    void open() override {}
    void close() noexcept override {}
    bool read(std::int64_t, DeviceReading&) noexcept override {
      while (reads_ == 0) std::this_thread::sleep_for(std::chrono::seconds(1));
      --reads_;
      return true;
    }
    bool write(const Vector3&) noexcept override { return true; }

   private:
    unsigned reads_;
  };
  const auto life = [](unsigned reads, bool stop) {
    BlockedDevice device(reads);
    KalmanRenderer renderer;
    MonotonicClock clock;
    const auto servo = std::make_unique<ServoLoop>(device, renderer, clock, ServoOptions());
    ServoThread thread(*servo, {.real_time = false});
    while (!thread.looping() || servo->ticks() < reads) std::this_thread::yield();
    if (stop) thread.stop();
  };
  const auto stuck = ::testing::ExitedWithCode(ServoThread::kStuckCode);
  EXPECT_EXIT(life(0, true), stuck, "adapter did not return from a call");
  EXPECT_EXIT(life(20, false), stuck, "adapter did not return from a call");
}

TEST(ServoThreads, ExceptionArrivesWhereTheLoopIsStopped) {
  PressedDevice device;
  KalmanRenderer renderer;
  MonotonicClock clock;
  const auto servo = std::make_unique<ServoLoop>(device, renderer, clock, ServoOptions());
  ServoThread before(*servo, {.real_time = false, .begins = [] { throw std::runtime_error("no memory"); }});
  EXPECT_THROW(before.stop(), std::runtime_error);
  EXPECT_TRUE(before.over());
  EXPECT_EQ(servo->ticks(), 0u);
  before.stop();  // once is enough
  ServoThread after(*servo, {.real_time = false, .ended = [] { throw std::runtime_error("no memory"); }});
  EXPECT_THROW(after.stop(), std::runtime_error);
  EXPECT_GT(servo->ticks(), 0u);
  // Nobody asks: swallowed, and the process lives.
  ServoThread unasked(*servo, {.real_time = false, .begins = [] { throw std::runtime_error("no memory"); }});
}

TEST(ServoThreads, NothingIsLostOrTornInTheTelemetryRing) {
  struct Wide {
    std::uint64_t words[16] = {};
  };
  const auto ring = std::make_unique<Ring<Wide, 64>>();
  constexpr std::uint64_t kCount = 100'000;
  std::thread writer([&] {
    Wide wide;
    for (std::uint64_t n = 1; n <= kCount; ++n) {
      for (auto& word : wide.words) word = n;
      while (!ring->push(wide)) std::this_thread::yield();
    }
  });
  Wide wide;
  for (std::uint64_t n = 1; n <= kCount; ++n) {
    while (!ring->pop(wide)) std::this_thread::yield();
    for (const auto word : wide.words) ASSERT_EQ(word, n);
  }
  writer.join();
}

}  // namespace
}  // namespace teletact::client
