// The fault table of makers' devices: what the operator is told, and that the force goes and stays away,
// through the plugin, the device's process and the whole safety chain, at the pace of a clock.
#include <cmath>
#include <cstdio>

#include "client/clock/clock.h"
#include "client/haptic/workspace.h"
#include "client/render/kalman_renderer.h"
#include "client/servo/servo_loop.h"
#include "tests/haptic/boxed_device.h"
#include "tests/render/analytic_tissue.h"

namespace teletact::client {
namespace {

class BoxedFaults : public test::BoxedTest {
 protected:
  void SetUp() override {
    device = std::make_unique<WorkspaceDevice>(make(), WorkspaceOptions(), start_m);
    device->open();
    ServoOptions options;
    options.chain.limits = device->profile().limits();
    options.chain.start_ramp_s = 0.1;  // a quick test
    slew_n_s = options.chain.limits.largest_slew_n_s;
    servo = std::make_unique<ServoLoop>(*device, renderer, clock, options);
    ASSERT_TRUE(until([&] { return servo->ticks() > 0 && last.device_ok; }));  // where it begins
  }

  void tick() {
    clock.sleep_until_ns(clock.now_ns() + 1'000'000);
    const std::int64_t now_ns = clock.now_ns();
    noise_m = 1e-6 * std::sin(++moment);  // no hand holds a device still to the last bit
    hold_hand();
    ServoAnswer answer;
    answer.sample = tissue.told(last.pose.position_m, seconds(now_ns), ++sequence);
    answer.received_ns = now_ns;
    answer.covered = true;
    answer.region.end_x_m = 0.1;
    answer.period_s = 0.005;  // whatever the machine does
    servo->answers().put(answer);
    servo->tick(now_ns);
    ServoTick next;
    while (servo->telemetry().pop(next)) {
      const double passed_s = seconds(next.time_ns - last.time_ns);
      const double dt_s = last.reason == StateReason::kFrozen ? 3 * passed_s : std::min(passed_s, 0.002);
      if (next.state == ServoState::kFault && last.state == ServoState::kFault) {
        // A finger that lifts, or seems to by a jump, is pushed no stiffer than before.
        const double left = std::max(depth_of(next), 0.0) / depth_of(last);
        const double lifts_n = last.force_n.norm() * (1 - left);
        EXPECT_LE((next.force_n - last.force_n).norm(), std::max(slew_n_s * dt_s, lifts_n) + 1e-12);
        EXPECT_LE(next.force_n.norm(), last.force_n.norm());
      }
      last = next;
    }
    const std::string news = device->trouble();
    if (!news.empty()) said += news + "\n";
  }
  static double depth_of(const ServoTick& tick) { return tick.pose.position_m.y(); }
  bool until(const std::function<bool()>& met) {
    const std::int64_t end_ns = clock.now_ns() + 30'000'000'000;
    while (!met() && clock.now_ns() < end_ns) tick();
    return met();
  }
  void go_on(double seconds) {
    const std::int64_t end_ns = clock.now_ns() + std::llround(1e9 * seconds);
    while (clock.now_ns() < end_ns) tick();
  }
  void put_depth(double depth) {
    depth_m = depth;
    hold_hand();
  }
  void hold_hand() { put_hand(Vector3(0.001, 0.002 + 0.005 + depth_m + noise_m, 0.003)); }
  // Of 4 mm, after a resume out of contact. A machine that is too busy may make a fault of its own: once
  // more.
  bool resume() {
    put_depth(-0.002);
    go_on(0.02);
    return until([&] {
      servo->request_resume();
      return last.state == ServoState::kEnabled;
    });
  }
  void press() {
    for (int attempt = 0; attempt < 20; ++attempt) {
      if (!resume()) break;
      for (double depth_m = -0.002; depth_m < 0.004; depth_m += 2e-4) {
        put_depth(depth_m);
        go_on(0.003);
      }
      go_on(0.1);
      if (last.state == ServoState::kEnabled && last.force_n.norm() > 0.3) break;
    }
    ASSERT_EQ(last.state, ServoState::kEnabled) << said << describe(last.reason);
    ASSERT_TRUE(until([&] { return force_n().norm() > 0.3; }));  // not while a busy machine lets it go
    said.clear();
  }
  void expect_fault(StateReason reason) {
    ASSERT_TRUE(until([&] { return last.state == ServoState::kFault; })) << said;
    EXPECT_EQ(last.reason, reason) << describe(last.reason);
    EXPECT_TRUE(until([&] { return last.force_n.norm() == 0; }));
  }
  // Pressed anew where the machine gave the device's process no turn: that is a lost device before any other.
  void expect_fault_by(int mode, StateReason reason, double then_m = 0.004) {
    for (int attempt = 0; attempt < 10; ++attempt) {
      ASSERT_NO_FATAL_FAILURE(press());
      fake->mode = mode;
      put_depth(then_m);
      ASSERT_TRUE(until([&] { return last.state == ServoState::kFault; })) << said;
      if (last.reason != StateReason::kDeviceLost) break;
      fake->mode = FAKE_WELL;
    }
    expect_fault(reason);
    EXPECT_TRUE(until([&] { return force_n().norm() == 0; }));
  }
  bool told(const std::string& part) {
    return until([&] { return said.find(part) != std::string::npos; });
  }
  // It comes back by itself for nothing, and at once when it is resumed with the finger lifted.
  void expect_recovery() {
    fake->mode = FAKE_WELL;
    put_depth(0.004);
    EXPECT_TRUE(until([&] { return last.device_ok && force_n().norm() == 0; }));
    const std::int64_t from = fake->turns;
    EXPECT_TRUE(until([&] {
      EXPECT_EQ(force_n().norm(), 0);
      return fake->turns > from + 50;
    }));
    EXPECT_NE(last.state, ServoState::kEnabled);
    EXPECT_TRUE(resume());
  }

  std::unique_ptr<WorkspaceDevice> device;
  double depth_m = -0.005, noise_m = 0, moment = 0;
  KalmanRenderer renderer;
  MonotonicClock clock;
  test::AnalyticTissue tissue;
  std::unique_ptr<ServoLoop> servo;
  ServoTick last;
  std::uint64_t sequence = 0;
  double slew_n_s = 0;
  std::string said;
};

TEST_P(BoxedFaults, LostInTheMiddle) {
  press();
  fake->mode = FAKE_LOST;
  expect_fault(StateReason::kDeviceLost);
  EXPECT_TRUE(told("communication error")) << said;
  EXPECT_TRUE(told("it cannot be opened again")) << said;
  const int opened = fake->opened;
  fake->mode = FAKE_WELL;
  EXPECT_TRUE(told("it answers again: lift the finger and resume")) << said;
  EXPECT_GT(fake->opened, opened);
  expect_recovery();
}

TEST_P(BoxedFaults, ForcesAreRefused) {
  press();
  fake->mode = FAKE_REFUSES;
  expect_fault(StateReason::kDeviceLost);
  EXPECT_TRUE(told(GetParam().api == "libdhd" ? "dhdSetForce failed" : "warm motors (0x0200)")) << said;
  expect_recovery();
}

TEST_P(BoxedFaults, SlowCallsAreSaidAndSlowerOnesAreALostDevice) {
  press();
  fake->slow_ms = 30;
  fake->mode = FAKE_SLOW;
  EXPECT_TRUE(told("the maker's library took ")) << said;
  EXPECT_LE(force_n().norm(), device->profile().largest_force_n);
  fake->slow_ms = 180;
  expect_fault(StateReason::kDeviceLost);
  // The device takes a force between two of its calls: none any more.
  EXPECT_TRUE(until([&] { return force_n().norm() == 0; }));
}

TEST_P(BoxedFaults, ACallThatHangsEndsTheProcess) {
  press();
  fake->mode = FAKE_HANGS;
  expect_fault(StateReason::kDeviceLost);
  EXPECT_TRUE(told("does not return from a call, and its process was ended: see to the device")) << said;
  const int box = fake->box;
  ASSERT_TRUE(until([&] { return test::has_ended(box); }));
  fake->mode = FAKE_WELL;
  go_on(0.15);
  EXPECT_EQ(last.state, ServoState::kFault);
  EXPECT_FALSE(last.device_ok);
}

TEST_P(BoxedFaults, APositionThatIsNoNumber) {
  expect_fault_by(FAKE_NO_NUMBER, StateReason::kNotFinite);
  expect_recovery();
}

TEST_P(BoxedFaults, APositionThatJumps) {
  expect_fault_by(FAKE_JUMPS, StateReason::kTooFast);
  expect_recovery();
}

TEST_P(BoxedFaults, APositionThatIsStuck) {
  expect_fault_by(FAKE_STUCK, StateReason::kFrozen, 0.008);
  EXPECT_TRUE(told("is frozen: its position stands still to the last bit")) << said;
  expect_recovery();
}

INSTANTIATE_TEST_SUITE_P(Makers, BoxedFaults, ::testing::ValuesIn(test::makers()),
                         [](const auto& info) { return info.param.plugin; });

}  // namespace
}  // namespace teletact::client
