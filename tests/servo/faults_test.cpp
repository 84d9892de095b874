// Faults and what comes after them: a device that is lost, a held button, a model from before.
#include <gtest/gtest.h>

#include <algorithm>

#include "tests/servo/servo_test.h"

namespace teletact::client {
namespace {

using test::ServoTest;

class FaultsTest : public ServoTest {
 protected:
  void press_the_tissue() {
    enable();
    put_finger(0.004);
    run(1);
    ASSERT_GT(device.force.norm(), 0.5);
    largest_step_n = 0;
  }
  double slew_n() const { return options.chain.limits.largest_slew_n_s * 0.001 + 1e-12; }
  void button(bool down) { device.reading.resume_pressed = down; }
};

TEST_F(FaultsTest, LostDeviceFadesTheForceUntilResumed) {
  press_the_tissue();
  device.ok = false;
  double last_n = device.force.norm();
  for (int tick = 0; tick < 80; ++tick) {
    run(0.001);
    EXPECT_EQ(last.state, ServoState::kFault);
    EXPECT_EQ(last.reason, StateReason::kDeviceLost);
    EXPECT_LE(device.force.norm(), last_n);
    last_n = device.force.norm();
  }
  EXPECT_EQ(last_n, 0);
  EXPECT_LE(largest_step_n, slew_n());
  // WHEN it is there again THEN nothing comes by itself, nor while pressed
  device.ok = true;
  run(0.3);
  servo->request_resume();
  run(0.3);
  EXPECT_EQ(last.state, ServoState::kFault);
  EXPECT_EQ(device.force.norm(), 0);
  // but after lifting and resuming everything is as before
  enable();
  put_finger(0.004);
  run(1);
  const Vector3 truth = tissue.answer({0.02, 0.004, 0}).force_n;
  EXPECT_LE((device.force - truth).norm(), 0.01 * truth.norm());
}

TEST_F(FaultsTest, HeldButtonBringsNoForceBackAfterAFault) {
  put_finger(-0.003);
  run(0.05);
  button(true);
  run(0.01);
  ASSERT_EQ(last.state, ServoState::kEnabled);
  for (const bool seen : {true, false}) {
    // WHEN the device is lost, whether or not the button was seen to be let go before
    if (!seen) {
      button(false);
      run(0.01);
    }
    device.ok = false;
    button(true);
    run(0.02);
    device.ok = true;
    run(0.5);
    EXPECT_EQ(last.state, ServoState::kFault) << seen;
    button(false);
    run(0.01);
    EXPECT_EQ(last.state, ServoState::kFault) << seen;
    button(true);
    run(0.001);
    EXPECT_EQ(last.state, ServoState::kEnabled) << seen;
  }
}

TEST_F(FaultsTest, ButtonThatSticksGivesNoForce) {
  button(true);
  put_finger(-0.003);
  run(0.5);
  EXPECT_EQ(last.state, ServoState::kDisabled);
}

// A press that is not granted is not kept, however long the button stays down.
TEST_F(FaultsTest, ButtonPressedInContactGivesNoForce) {
  put_finger(0.002);
  run(0.05);
  button(true);
  run(0.05);
  put_finger(-0.003);
  run(0.5);
  EXPECT_EQ(last.state, ServoState::kDisabled);
}

TEST_F(FaultsTest, ForceNeedsTheWholeClearance) {
  for (const double y_m : {0.0004, 0.0, -0.0004}) {
    put_finger(y_m);
    run(0.02);
    servo->request_resume();
    run(0.01);
    EXPECT_EQ(last.state, ServoState::kDisabled) << y_m;
  }
  put_finger(-0.0006);
  run(0.02);
  servo->request_resume();
  run(0.01);
  EXPECT_EQ(last.state, ServoState::kEnabled);
}

// GIVEN a fault while pressed WHEN force is resumed at once and the service gives none any more THEN nothing
// is felt of what was known before.
TEST_F(FaultsTest, NothingIsRenderedOfWhatWasKnownBeforeAFault) {
  press_the_tissue();
  put_finger(NAN);
  run(0.001);
  ASSERT_EQ(last.state, ServoState::kFault);
  has_force = false;
  put_finger(-0.003);
  run(0.003);
  servo->request_resume();
  run(0.002);
  ASSERT_EQ(last.state, ServoState::kEnabled);
  put_finger(0.004);
  for (int tick = 0; tick < 150; ++tick) {
    run(0.001);
    ASSERT_EQ(device.force.norm(), 0) << tick;
  }
  EXPECT_EQ(last.state, ServoState::kEnabled);
  EXPECT_EQ(last.sequence, 0u);
  EXPECT_EQ(last.stiffness_n_m, 0);
  EXPECT_GT(last.model_age_s, 1);
}

// One answer is enough afterwards: it is no outlier of the old model, which is gone.
TEST_F(FaultsTest, FirstAnswerAfterAFaultIsBelieved) {
  press_the_tissue();
  put_finger(NAN);
  run(0.001);
  ASSERT_EQ(last.state, ServoState::kFault);
  tissue.stiffness /= 8;
  put_finger(-0.003);
  run(0.001);
  has_force = false;
  servo->request_resume();
  run(0.003);
  ASSERT_EQ(last.state, ServoState::kEnabled);
  put_finger(5e-4);  // as deep as was foretold
  run(0.15);
  const Vector3 truth = tissue.answer({0.02, 5e-4, 0}).force_n;
  const double gain = start_gain(0.15, options.chain.start_ramp_s);
  EXPECT_NEAR(device.force.norm(), gain * truth.norm(), 0.1 * gain * truth.norm());
}

}  // namespace
}  // namespace teletact::client
