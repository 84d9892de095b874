#include "client/link/servo_messages.h"

#include <gtest/gtest.h>

#include <cmath>

namespace teletact::client {
namespace {

v1::TouchAnswer answer(v1::TouchStatus status) {
  v1::TouchAnswer answer;
  answer.set_status(status);
  for (const double value : {0.01, 0.002, 0.0}) answer.add_position_m(value);
  for (const double value : {0.1, -0.6, 0.0}) answer.add_force_n(value);
  for (int k = 0; k < 9; ++k) answer.add_tangent_n_m(-300);
  return answer;
}

TEST(ServoMessages, TheServicesDoubtReachesTheServo) {
  const auto good = to_servo_answer(answer(v1::TOUCH_STATUS_OK), {}, 0.002, 1);
  const auto doubted = to_servo_answer(answer(v1::TOUCH_STATUS_DEGRADED), {}, 0.002, 1);
  ASSERT_TRUE(good && doubted);
  EXPECT_FALSE(good->degraded);
  EXPECT_TRUE(doubted->degraded);
  EXPECT_TRUE(doubted->has_force);
  EXPECT_EQ(doubted->sample.force_n, good->sample.force_n);
}

TEST(ServoMessages, WhileALineIsBeingPreparedThereIsNoForce) {
  const auto preparing = to_servo_answer(answer(v1::TOUCH_STATUS_PREPARING), {}, 0.002, 1);
  ASSERT_TRUE(preparing);
  EXPECT_FALSE(preparing->has_force);
  EXPECT_FALSE(preparing->degraded);
}

TEST(ServoMessages, AllThreeComponentsComeFromTheServiceAndGoToIt) {
  v1::TouchAnswer in = answer(v1::TOUCH_STATUS_OK);
  in.set_position_m(0, 0.01), in.set_position_m(1, 0.002), in.set_position_m(2, 0.03);
  in.set_force_n(2, 0.25);
  for (int k = 0; k < 9; ++k) in.set_tangent_n_m(k, k);
  const auto servo = to_servo_answer(in, {.offset_m = 0.001}, 0.002, 1);
  ASSERT_TRUE(servo);
  EXPECT_EQ(servo->sample.position_m, Vector3(0.01, 0.002, 0.03));
  EXPECT_EQ(servo->sample.force_n, Vector3(0.1, -0.6, 0.25));
  EXPECT_EQ(servo->sample.tangent_n_m.row(2), Eigen::RowVector3d(6, 7, 8));
  EXPECT_NEAR(servo->sample.surface.depth_m(servo->sample.position_m), 0.001, 1e-15);
  // a force across the plane alone is one, and two components are those of a plane
  for (const int axis : {0, 1}) in.set_force_n(axis, 0);
  EXPECT_TRUE(to_servo_answer(in, {}, 0.002, 1)->sample.contact);
  in = answer(v1::TOUCH_STATUS_OK);
  in.mutable_position_m()->Truncate(2), in.mutable_force_n()->Truncate(2);
  EXPECT_EQ(to_servo_answer(in, {}, 0.002, 1)->sample.force_n, Vector3(0.1, -0.6, 0));
  in.mutable_force_n()->Truncate(1);
  EXPECT_FALSE(to_servo_answer(in, {}, 0.002, 1));
  const ServoPose pose{{{0.01, 0.002, 0.03}, {0.1, 0.2, 0.3}}, 5};
  const v1::ContactPose out = to_request(pose, 1, 0, 2).pose();
  EXPECT_EQ(vector_from(out.position_m()), pose.pose.position_m);
  EXPECT_EQ(vector_from(out.velocity_m_s()), pose.pose.velocity_m_s);
  const v1::ServoSample sample = to_record({.pose = pose.pose, .force_n = {0.1, -0.2, 0.3}}).servo();
  EXPECT_EQ(vector_from(sample.position_m()), pose.pose.position_m);
  EXPECT_EQ(vector_from(sample.velocity_m_s()), pose.pose.velocity_m_s);
  EXPECT_EQ(vector_from(sample.force_n()), Vector3(0.1, -0.2, 0.3));
}

TEST(ServoMessages, LayerIsThePlaneAcrossItsNormal) {
  v1::Layer layer;
  layer.set_depth_m(0.01);
  EXPECT_EQ(surface_from(layer)->depth_m({0.3, 0.012, -0.2}), 0.012 - 0.01);
  for (const double component : {0.6, 0.8, 0.0}) layer.add_normal(component);
  const auto surface = surface_from(layer);
  ASSERT_TRUE(surface);
  EXPECT_NEAR(surface->depth_m({0, 0.01, 0.5}), 0, 1e-15);
  EXPECT_NEAR(surface->depth_m({0.006, 0.018, 0.5}), 0.01, 1e-15);
  layer.set_normal(0, 0.7);
  EXPECT_FALSE(surface_from(layer));
  layer.mutable_normal()->Clear();
  layer.set_depth_m(NAN);
  EXPECT_FALSE(surface_from(layer));
}

TEST(ServoMessages, ARegionWithoutBothEndsAlongZReachesAllTheWay) {
  v1::Region region;
  region.set_begin_x_m(0.1), region.set_end_x_m(0.2), region.set_end_z_m(0.3);
  EXPECT_EQ(region_from(region)->begin_x_m, 0.1);
  EXPECT_EQ(region_from(region)->end_x_m, 0.2);
  EXPECT_EQ(region_from(region)->end_z_m, INFINITY);
  region.set_begin_z_m(-0.3);
  EXPECT_EQ(region_from(region)->begin_z_m, -0.3);
  EXPECT_EQ(region_from(region)->end_z_m, 0.3);
  for (const double begin_m : {double(NAN), 0.4}) {
    region.set_begin_z_m(begin_m);
    EXPECT_FALSE(region_from(region)) << begin_m;
  }
}

TEST(ServoMessages, ARecordedTickSaysEverythingThatTheServoKnows) {
  ServoTick tick;
  tick.state = ServoState::kPaused;
  tick.reason = StateReason::kSilence;
  tick.degraded = tick.energy_generated = tick.service_degraded = tick.faded = true;
  tick.stiffness_n_m = 310;
  tick.stiffness_variance = 16;
  tick.lateral_stiffness_n_m = {-41, 7};
  tick.lateral_stiffness_variance = {25, 9};
  tick.gain = 0.4;
  tick.energy_j = -0.003;
  tick.stored_j = 0.002;
  tick.damping_n_s_m = 1.5;
  tick.withheld = 0.3;
  tick.balance_j = 0.004;
  tick.refused = {EnergyClaim::kLaw, 0.006};
  const v1::ServoSample sample = to_record(tick).servo();
  EXPECT_EQ(sample.reason(), static_cast<std::uint32_t>(StateReason::kSilence));
  EXPECT_TRUE(sample.degraded() && sample.indebted() && sample.service_degraded() && sample.faded());
  EXPECT_EQ(sample.stiffness_n_m(), 310);
  EXPECT_EQ(sample.stiffness_variance(), 16);
  ASSERT_EQ(sample.lateral_stiffness_n_m_size(), 2);
  EXPECT_EQ(sample.lateral_stiffness_n_m(0), -41);
  EXPECT_EQ(sample.lateral_stiffness_n_m(1), 7);
  ASSERT_EQ(sample.lateral_stiffness_variance_size(), 2);
  EXPECT_EQ(sample.lateral_stiffness_variance(0), 25);
  EXPECT_EQ(sample.lateral_stiffness_variance(1), 9);
  EXPECT_EQ(sample.gain(), 0.4);
  EXPECT_EQ(sample.energy_j(), -0.003);
  EXPECT_EQ(sample.stored_j(), 0.002);
  EXPECT_EQ(sample.damping_n_s_m(), 1.5);
  EXPECT_EQ(sample.withheld(), 0.3);
  EXPECT_EQ(sample.balance_j(), 0.004);
  EXPECT_EQ(sample.claim(), static_cast<std::uint32_t>(EnergyClaim::kLaw));
  EXPECT_EQ(sample.claim_lacks_j(), 0.006);
  // What is false is there as well: a reader tells it from a recording that does not say.
  EXPECT_TRUE(to_record({}).servo().has_degraded());
  EXPECT_FALSE(to_record({}).servo().degraded());
}

}  // namespace
}  // namespace teletact::client
