// The loop with all its threads, in real time: what ThreadSanitizer looks at.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <thread>

#include "client/haptic/simulated_device.h"
#include "client/render/kalman_renderer.h"
#include "client/servo/servo_loop.h"
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
    answer.sample = tissue.answer(pose.pose.position_m, 1e-9 * static_cast<double>(pose.time_ns), ++sequence);
    answer.received_ns = clock.now_ns();
    answer.covered = true;
    answer.covered_end_m = 0.12;
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
    EXPECT_FALSE(device.ended());
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
