#include "client/haptic/workspace.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

namespace teletact::client {
namespace {

constexpr double kTiny = 1e-12;
const Vector3 kStart(0.06, -0.005, 0.01);

DeviceReading reading_at(const Vector3& position_m, bool clutched = false) {
  DeviceReading reading;
  reading.pose.position_m = position_m;
  reading.clutched = clutched;
  return reading;
}

// Where the finger goes when the device is moved by `way_m`.
Vector3 moved_m(const WorkspaceOptions& options, const Vector3& way_m) {
  WorkspaceMap map(options, kStart);
  DeviceReading reading = reading_at(kStart + way_m);
  map.map(reading);
  return reading.pose.position_m - kStart;
}

TEST(WorkspaceMap, TurnsAndScalesTheWay) {
  EXPECT_LE((moved_m({}, {0.01, 0.02, 0.03}) - Vector3(0.01, 0.02, 0.03)).norm(), kTiny);
  EXPECT_LE((moved_m({.axes = "z,y,-x"}, {0.01, 0.02, 0.03}) - Vector3(0.03, 0.02, -0.01)).norm(), kTiny);
  EXPECT_LE((moved_m({.scale = 4}, {0.01, 0, 0}) - Vector3(0.04, 0, 0)).norm(), kTiny);
  // Turned to the left, its right is away from the operator, and away is to the left.
  EXPECT_LE((moved_m({.rotation_deg = 90}, {0.01, 0, 0}) - Vector3(0, 0, 0.01)).norm(), kTiny);
  EXPECT_LE((moved_m({.rotation_deg = 90}, {0, 0.002, 0.01}) - Vector3(-0.01, 0.002, 0)).norm(), kTiny);
}

// Work at the hand is f / s of the scene's, whatever the turn.
TEST(WorkspaceMap, ScalesTheWorkOfEveryForceAlike) {
  const WorkspaceOptions options{
      .axes = "-y,z,-x", .rotation_deg = 33, .scale = 4, .force_scale = 1.5, .clutch_button = 0};
  const WorkspaceMap map(options, kStart);
  const Vector3 way_m(0.01, -0.02, 0.005), scene_n(0.4, -2, 0.7);
  EXPECT_NEAR(map.force_at_hand(scene_n).dot(way_m), 1.5 / 4 * scene_n.dot(moved_m(options, way_m)), kTiny);
  EXPECT_NEAR(map.force_at_hand(scene_n).norm(), 1.5 * scene_n.norm(), kTiny);
}

// What the chain keeps in the scene holds at the hand.
TEST(WorkspaceMap, StatesTheDevicesLimitsInTheScene) {
  const double s = 4, f = 0.5;
  const DeviceProfile device = device_profile("touch");
  const DeviceProfile scene = WorkspaceMap({.scale = s, .force_scale = f}, kStart).in_scene(device);
  const ForceLimits at_hand = device.limits(), limits = scene.limits();
  EXPECT_NEAR(limits.largest_force_n * f, at_hand.largest_force_n, kTiny);
  EXPECT_NEAR(limits.largest_stiffness_n_m * s * f, at_hand.largest_stiffness_n_m, 1e-9);
  EXPECT_NEAR(limits.largest_damping_n_s_m * s * f, at_hand.largest_damping_n_s_m, kTiny);
  EXPECT_NEAR(limits.largest_slew_n_s * f, at_hand.largest_slew_n_s, 1e-9);
  EXPECT_NEAR(limits.largest_speed_m_s, s * at_hand.largest_speed_m_s, kTiny);
  EXPECT_NEAR(limits.friction_n * f, at_hand.friction_n, kTiny);
  EXPECT_NEAR(limits.hand_n_s_m * s * f, at_hand.hand_n_s_m, kTiny);
  EXPECT_NEAR(limits.joules_per_hand_j, s / f, kTiny);
  EXPECT_NEAR(scene.workspace_radius_m, 0.3, kTiny);
}

TEST(WorkspaceMap, ClutchedTheFingerStandsStillAndGoesOnFromThere) {
  WorkspaceMap map({.scale = 3}, kStart);
  const auto at = [&](double x_m, bool clutched) {
    DeviceReading reading = reading_at(kStart + Vector3(x_m, 0, 0), clutched);
    reading.pose.velocity_m_s = {0.1, 0, 0};
    map.map(reading);
    return reading;
  };
  EXPECT_NEAR(at(0.02, false).pose.position_m.x(), kStart.x() + 0.06, kTiny);
  for (int n = 1; n <= 5; ++n) {
    const DeviceReading held = at(0.02 - 0.004 * (n - 1), true);
    EXPECT_NEAR(held.pose.position_m.x(), kStart.x() + 0.06, kTiny);
    EXPECT_EQ(held.pose.velocity_m_s.norm(), 0);
    EXPECT_NEAR(held.unseen.position_m.x(), -3 * 0.004 * (n - 1), kTiny);
    EXPECT_NEAR(held.unseen.velocity_m_s.x(), 0.3, kTiny);
  }
  const DeviceReading released = at(0.004, false);
  EXPECT_NEAR(released.pose.position_m.x(), kStart.x() + 0.06, kTiny);
  EXPECT_NEAR(released.pose.velocity_m_s.x(), 0.3, kTiny);
  EXPECT_EQ(released.unseen.velocity_m_s.norm(), 0);
  EXPECT_NEAR(at(0.006, false).pose.position_m.x(), kStart.x() + 0.066, kTiny);
  EXPECT_NEAR(at(0.006, false).unseen.position_m.x(), -0.048, kTiny);
}

// A position that is no number reaches the servo, which knows what to do, and moves nothing.
TEST(WorkspaceMap, OfNoNumberIsNoNumberAndMovesNothing) {
  WorkspaceMap map({.scale = 3}, kStart);
  for (const bool clutched : {false, true}) {
    DeviceReading bad = reading_at({NAN, 0, 0}, clutched);
    map.map(bad);
    EXPECT_FALSE(bad.pose.position_m.allFinite());
    DeviceReading good = reading_at(kStart, clutched);
    map.map(good);
    EXPECT_LE((good.pose.position_m - kStart).norm(), kTiny);
    EXPECT_EQ(good.unseen.position_m.norm(), 0);
  }
}

TEST(WorkspaceMap, RefusesWhatIsNoMap) {
  const auto complaint = [](const WorkspaceOptions& options) -> std::string {
    try {
      validate(options);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  for (const char* good : {"x,y,z", "z,y,-x", "-x,-y,z", "y,z,x"}) EXPECT_EQ(complaint({.axes = good}), "");
  for (const char* bad : {"", "x", "x,y", "x,y,y", "x,y,z,x", "x,y,w", "x=-z", "--x,y,z", "x,,z"})
    EXPECT_NE(complaint({.axes = bad}).find("name the device's axis"), std::string::npos) << bad;
  EXPECT_NE(complaint({.axes = "-x,y,z"}).find("mirror image"), std::string::npos);
  for (const double bad : {0.5, 21.0, static_cast<double>(NAN)})
    EXPECT_EQ(complaint({.scale = bad}).find("scale: give 1 to 20"), 0u) << bad;
  for (const double bad : {0.04, 2.1, static_cast<double>(NAN)})
    EXPECT_EQ(complaint({.scale = 2, .force_scale = bad}).find("force_scale: give 0.05 to the scale"), 0u);
  EXPECT_EQ(complaint({.scale = 2, .force_scale = 2}), "");
  EXPECT_EQ(complaint({.rotation_deg = 181}).find("rotation_deg: give"), 0u);
  EXPECT_EQ(complaint({.clutch_button = 33}).find("clutch_button: give"), 0u);
}

}  // namespace
}  // namespace teletact::client
