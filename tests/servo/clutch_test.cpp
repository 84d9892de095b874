// A workspace map and its clutch through the whole loop: what the hand feels while the device is moved on.
#include <cmath>
#include <cstdio>

#include "client/haptic/workspace.h"
#include "client/render/law_renderer.h"
#include "tests/render/tissue_law.h"
#include "tests/servo/servo_test.h"

namespace teletact::client {
namespace {

struct Mapping {
  double scale, force_scale;
  bool by_law;
};

class ClutchTest : public test::ServoTest, public ::testing::WithParamInterface<Mapping> {
 protected:
  // The finger begins over the middle of the law.
  ClutchTest() {
    begin(GetParam());
    version = 1;
    if (GetParam().by_law) servo->laws().put(test::law_of(tissue, version, 0, 0.06));
  }
  void begin(const Mapping& mapping) {
    const WorkspaceOptions map{.axes = "z,y,-x",
                               .rotation_deg = -90,  // together: x and z change their signs
                               .scale = mapping.scale,
                               .force_scale = mapping.force_scale,
                               .clutch_button = 2,
                               .without_noise = true};
    workspace = std::make_unique<WorkspaceDevice>(std::make_unique<test::Borrowed>(device), map, start_m);
    workspace->open();
    options.chain.limits = workspace->profile().limits();
    Renderer& chosen = mapping.by_law ? static_cast<Renderer&>(law_renderer) : renderer;
    servo = std::make_unique<ServoLoop>(*workspace, chosen, clock, options);
    device.reading.pose.position_m = hand_m = start_m;
    last.pose.position_m = start_m;
  }
  Vector3 finger_m() const override { return last.pose.position_m; }

  // Over `seconds`, to there; what the hand feels of it is summed up.
  void move_hand(const Vector3& to_m, double seconds) {
    const int ticks = static_cast<int>(std::lround(seconds * 1000));
    const Vector3 step_m = (to_m - hand_m) / ticks;
    for (int n = 0; n < ticks; ++n) {
      const Vector3 felt_n = device.force;
      hand_m += step_m;
      given_j += felt_n.dot(step_m);
      device.reading.pose.position_m = hand_m;
      device.reading.pose.velocity_m_s = step_m / 0.001;
      run(0.001);
      degraded = degraded || (last.degraded && last.state == ServoState::kEnabled);
      hand_step_n = std::max(hand_step_n, (device.force - felt_n).norm());
      hand_rise_n = std::max(hand_rise_n, device.force.norm() - felt_n.norm());
    }
  }
  void rest(double seconds) { move_hand(hand_m, seconds); }
  void clutch(bool down) { device.reading.buttons = down ? 2 : 0; }
  // So deep that the hand is pushed by some 0.5 to 1 N.
  void press() {
    rest(0.05);
    servo->request_resume();
    rest(0.7);
    ASSERT_EQ(last.state, ServoState::kEnabled);
    move_hand(hand_m + Vector3(0, 0.007 / GetParam().scale, 0), 0.2);
    rest(0.3);
    ASSERT_EQ(last.by_law, GetParam().by_law);
    ASSERT_GT(device.force.norm(), 0.2);
    hand_step_n = hand_rise_n = 0;
  }
  double slew_n() const { return device.profile().limits().largest_slew_n_s * 0.001 + 1e-12; }

  const Vector3 start_m{0.03, -0.003, 0};
  LawRenderer law_renderer;
  std::unique_ptr<WorkspaceDevice> workspace;
  Vector3 hand_m = start_m;
  double given_j = 0;                       // by the display to the hand
  double hand_step_n = 0, hand_rise_n = 0;  // the largest from tick to tick
  bool degraded = false;
};

TEST_P(ClutchTest, InTheTissueTheForceGoesAndComesBackWithoutAStep) {
  press();
  const Vector3 pressed_n = device.force, at_m = last.pose.position_m;
  // WHEN it is clutched and the hand goes elsewhere, up as well THEN the finger stands still without a force
  clutch(true);
  rest(0.001);
  move_hand(hand_m + Vector3(0.01, 0, 0), 0.2);
  EXPECT_EQ(device.force.norm(), 0);
  EXPECT_TRUE(last.clutched);
  move_hand(hand_m + Vector3(-0.04, -0.01, 0.02), 0.4);
  EXPECT_EQ(device.force.norm(), 0);
  EXPECT_EQ(last.pose.position_m, at_m);
  EXPECT_EQ(last.pose.velocity_m_s.norm(), 0);
  // WHEN it is released THEN the force comes back there
  clutch(false);
  double before_n = 0;
  for (int n = 0; n < 60; ++n) {
    rest(0.01);
    EXPECT_GE(device.force.norm(), before_n - 1e-3);
    before_n = device.force.norm();
  }
  EXPECT_NEAR((device.force - pressed_n).norm(), 0, 0.01 * pressed_n.norm());
  EXPECT_LE((last.pose.position_m - at_m).norm(), 1e-12);
  EXPECT_FALSE(last.clutched);
  EXPECT_EQ(last.state, ServoState::kEnabled);
  EXPECT_FALSE(degraded);
  std::printf("[ clutch ] scale %g, force %g, %s: largest step %.2f mN a tick of %.1f allowed, %.2f N held\n",
              GetParam().scale, GetParam().force_scale, GetParam().by_law ? "law" : "kalman",
              1e3 * hand_step_n, 1e3 * slew_n(), pressed_n.norm());
  EXPECT_LE(hand_step_n, slew_n());
  // and the finger lifts as it pressed: over it all the hand was given no more than that forces are held for
  // a tick, half a tick's way at each end.
  move_hand(hand_m + Vector3(0, -0.007 / GetParam().scale, 0), 0.2);
  EXPECT_EQ(device.force.norm(), 0);
  EXPECT_LE(given_j, 1.2 * pressed_n.norm() * 0.007 / GetParam().scale / 200);
}

// A hand that lifts in the very moment takes no force along, and finds the finger pressed when it lets go.
TEST_P(ClutchTest, AHandThatLiftsAtOnceLeavesTheFingerPressed) {
  press();
  const Vector3 pressed_n = device.force, at_m = last.pose.position_m;
  clutch(true);
  rest(0.001);
  move_hand(hand_m + Vector3(0, -0.02, 0), 0.2);  // 0.1 m/s, while the force fades
  EXPECT_EQ(device.force.norm(), 0);
  EXPECT_EQ(last.pose.position_m, at_m);
  EXPECT_LE(given_j, pressed_n.norm() * 0.1 * 0.15) << "more than the whole force until it has faded";
  clutch(false);
  rest(0.01);
  EXPECT_LT(device.force.norm(), 0.3 * pressed_n.norm()) << "it comes back slowly";
  rest(0.6);
  EXPECT_EQ(last.pose.position_m, at_m);
  EXPECT_NEAR((device.force - pressed_n).norm(), 0, 0.01 * pressed_n.norm());
  EXPECT_LE(hand_rise_n, slew_n());  // it may fall sooner: the hand goes along
  move_hand(hand_m + Vector3(0, -0.01 / GetParam().scale, 0), 0.2);
  EXPECT_EQ(device.force.norm(), 0);
  EXPECT_EQ(last.state, ServoState::kEnabled);
}

// The hand goes where it is pushed while the force fades, again and again: that would be energy for nothing,
// were its way not counted. Of that the controller takes the force away sooner; it never steps up.
TEST_P(ClutchTest, AHandGetsNoEnergyOutOfFadingForces) {
  options.chain.limits.friction_n = 0;  // which would pay for it
  Renderer& chosen = GetParam().by_law ? static_cast<Renderer&>(law_renderer) : renderer;
  servo = std::make_unique<ServoLoop>(*workspace, chosen, clock, options);
  if (GetParam().by_law) servo->laws().put(test::law_of(tissue, version, 0, 0.06));
  press();
  for (int n = 0; n < 40; ++n) {
    clutch(true);
    rest(0.001);
    const Vector3 pushed_n = device.force;
    if (pushed_n.norm() > 0.01) move_hand(hand_m + pushed_n.normalized() * 0.01, 0.1);
    rest(0.1);
    EXPECT_EQ(device.force.norm(), 0);
    clutch(false);
    rest(0.6);
  }
  // Past its limit the debt is said, and the force fades: a little more until it has.
  std::printf("[ clutch ] %.2f mJ of %.2f in 40 fades\n", 1e3 * given_j, 1e3 * options.chain.debt_limit_j);
  EXPECT_LE(given_j, 1.3 * options.chain.debt_limit_j);
  EXPECT_LE(hand_rise_n, slew_n());
}

TEST_P(ClutchTest, InTheAirItTakesTheFingerOn) {
  rest(0.05);
  servo->request_resume();
  rest(0.7);
  Reach reach;
  ASSERT_TRUE(workspace->reach().take(reach));
  EXPECT_NEAR(reach.radius_m, GetParam().scale * device.profile().workspace_radius_m, 1e-12);
  const double finger_x_m = last.pose.position_m.x();
  clutch(true);
  rest(0.001);
  move_hand(hand_m + Vector3(0.03, 0, 0), 0.3);
  EXPECT_FALSE(workspace->reach().take(reach));
  clutch(false);
  rest(0.01);
  const Vector3 before_m = reach.centre_m;
  ASSERT_TRUE(workspace->reach().take(reach));
  EXPECT_NEAR(std::abs(reach.centre_m.x() - before_m.x()), GetParam().scale * 0.03, 1e-9);
  EXPECT_NEAR(last.pose.position_m.x(), finger_x_m, 1e-12);
  EXPECT_EQ(last.state, ServoState::kEnabled);
  // By a key as by the button.
  workspace->toggle_clutch();
  rest(0.001);
  move_hand(hand_m - Vector3(0.03, 0, 0), 0.3);
  EXPECT_NEAR(last.pose.position_m.x(), finger_x_m, 1e-12);
  workspace->toggle_clutch();
  rest(0.001);
  EXPECT_FALSE(degraded);
}

TEST_P(ClutchTest, AHandThatRunsAwayWhileItIsClutchedIsAFault) {
  press();
  clutch(true);
  rest(0.02);
  move_hand(hand_m + Vector3(0.05, 0, 0), 0.01);
  EXPECT_EQ(last.state, ServoState::kFault);
  EXPECT_EQ(last.reason, StateReason::kTooFast);
}

// Tissue harder than the device may show at this scale.
TEST_P(ClutchTest, TheStiffnessAtTheHandIsTheDevicesAtMost) {
  tissue.stiffness *= 10;
  begin(GetParam());
  version = 2;
  if (GetParam().by_law) servo->laws().put(test::law_of(tissue, version, 0, 0.06));
  const double hardest_n_m = device.profile().largest_stiffness_n_m;
  rest(0.05);
  servo->request_resume();
  rest(0.7);
  const double surface_m =
      start_m.y() - start_m.y() / GetParam().scale;  // of the hand, where the finger is at 0
  double largest_n = 0;
  for (int n = 0; n < 300; ++n) {
    move_hand(hand_m + Vector3(0, 2e-5 / GetParam().scale, 0), 0.001);
    EXPECT_LE(device.force.norm(), hardest_n_m * std::max(hand_m.y() - surface_m, 0.0) + 1e-9);
    EXPECT_LE(device.force.norm(), device.profile().largest_force_n + 1e-9);
    largest_n = std::max(largest_n, device.force.norm());
  }
  EXPECT_GT(largest_n, 0.3);
  EXPECT_EQ(last.state, ServoState::kEnabled);
}

INSTANTIATE_TEST_SUITE_P(Mappings, ClutchTest,
                         ::testing::Values(Mapping{1, 1, false}, Mapping{1, 1, true}, Mapping{4, 1, false},
                                           Mapping{4, 1, true}, Mapping{4, 4, true}, Mapping{3, 0.5, false}),
                         [](const auto& info) { return "No" + std::to_string(info.index); });

}  // namespace
}  // namespace teletact::client
