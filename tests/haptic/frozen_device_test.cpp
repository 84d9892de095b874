// A device whose messages flow while its position stands: from the device's read to the force on the hand.
#include "client/haptic/inverse3_device.h"
#include "client/haptic/workspace.h"
#include "tests/haptic/inverse3_service.h"
#include "tests/servo/servo_test.h"

namespace teletact::client {
namespace {

class FrozenDevice : public test::ServoTest {
 protected:
  void begin(bool without_noise) {
    WorkspaceOptions workspace;
    workspace.without_noise = without_noise;
    map = std::make_unique<WorkspaceDevice>(std::make_unique<test::Borrowed>(device), workspace,
                                            Vector3::Zero());
    map->open();
    servo = std::make_unique<ServoLoop>(*map, renderer, clock, options);
  }
  // A hand in steps of a tick, with noise unless it is frozen.
  void hold(double to_m, double seconds) {
    const double from_m = device.reading.pose.position_m.y();
    const int ticks = static_cast<int>(std::lround(1000 * seconds));
    for (int n = 1; n <= ticks; ++n) {
      put_finger(from_m + (to_m - from_m) * n / ticks + (n % 2 ? 1e-7 : 0));
      run(0.001);
    }
  }
  void resume() {
    hold(-0.003, 0.2);
    servo->request_resume();
    hold(-0.003, 0.01);
  }
  void press(double depth_m) {
    resume();
    ASSERT_EQ(last.state, ServoState::kEnabled);
    hold(depth_m, 1);
    hold(depth_m, 1);
    ASSERT_EQ(last.state, ServoState::kEnabled);
  }
  // Seconds until the hand feels nothing.
  double until_zero_s() {
    double s = 0;
    while (s < 0.3 && device.force.norm() > 0) run(0.001), s += 0.001;
    return s;
  }

  std::unique_ptr<WorkspaceDevice> map;
};

TEST_F(FrozenDevice, GivesNoForceWithin150MsHoweverMuchItGave) {
  for (const double depth_m : {0.004, 0.018}) {
    begin(false);
    press(depth_m);
    EXPECT_GT(device.force.norm(), depth_m > 0.01 ? 5 : 0.5);
    EXPECT_EQ(map->trouble(), "");
    EXPECT_LE(until_zero_s(), 0.15) << depth_m;
    EXPECT_EQ(last.state, ServoState::kFault);
    EXPECT_EQ(last.reason, StateReason::kFrozen);
    const std::string said = map->trouble();
    EXPECT_NE(said.find("is frozen: its position stands still to the last bit"), std::string::npos) << said;
    EXPECT_EQ(map->trouble(), "") << "said once";
  }
}

TEST_F(FrozenDevice, ForceComesBackByTheOperatorAlone) {
  begin(false);
  press(0.01);
  run(0.104);  // amid the fade
  ASSERT_EQ(last.state, ServoState::kFault);
  const double left_n = device.force.norm();
  ASSERT_GT(left_n, 0);
  // WHEN it follows the hand again THEN the force goes on to zero, and stays there
  double max_n = 0;
  for (int n = 0; n < 300; ++n) {
    hold(0.01, 0.001);
    max_n = std::max(max_n, device.force.norm());
    if (n > 35) {
      ASSERT_EQ(device.force.norm(), 0) << n;
    }
  }
  EXPECT_LE(max_n, left_n);
  servo->request_resume();
  hold(0.01, 0.1);
  EXPECT_EQ(last.state, ServoState::kFault);
  press(0.004);
  EXPECT_GT(device.force.norm(), 0.5);
}

TEST_F(FrozenDevice, MayStandWithoutNoiseWhileVelocityAgrees) {
  begin(true);
  press(0.004);
  run(2);
  EXPECT_EQ(last.state, ServoState::kEnabled);
  EXPECT_GT(device.force.norm(), 0.5);
  device.reading.velocity_stated = true;
  device.reading.pose.velocity_m_s = Vector3(0, -0.25, 0);
  EXPECT_LE(until_zero_s(), 0.15);
  EXPECT_EQ(last.reason, StateReason::kFrozen);
  EXPECT_NE(map->trouble().find("while its velocity says that it moves"), std::string::npos);
}

// The velocity that is derived from positions says nothing of them.
TEST_F(FrozenDevice, ADerivedVelocityIsNoContradiction) {
  begin(true);
  press(0.004);
  device.reading.pose.velocity_m_s = Vector3(0, -0.05, 0);
  run(0.3);
  EXPECT_EQ(last.state, ServoState::kEnabled);
}

// GIVEN an Inverse Service whose cursor stands while its velocity says -0.25 m/s, or whose grip turns
TEST(FrozenInverse3, IsToldByItsVelocityAndByItsGrip) {
  test::Inverse3Service service;
  for (const bool by_velocity : {true, false}) {
    WorkspaceDevice device(std::make_unique<Inverse3Device>(Inverse3Options{.url = service.url()}),
                           {.without_noise = true}, Vector3::Zero());
    service.turns = false;
    service.put_cursor({0.01, -0.12, 0.15}, {0, 0, 0});
    device.open();
    service.turns = !by_velocity;
    if (by_velocity) service.put_cursor({0.01, -0.12, 0.15}, {0, 0, -0.25});
    DeviceReading reading;
    MonotonicClock clock;
    const std::int64_t end_ns = clock.now_ns() + 30'000'000'000;
    while (!reading.frozen && clock.now_ns() < end_ns) {
      clock.sleep_until_ns(clock.now_ns() + 1'000'000);
      device.read(clock.now_ns(), reading);
      device.write({0, -0.1, 0});
    }
    EXPECT_TRUE(reading.frozen);
    const std::string said = device.trouble();
    EXPECT_NE(said.find(by_velocity ? "its velocity says" : "its orientation turns"), std::string::npos)
        << said;
  }
}

}  // namespace
}  // namespace teletact::client
