// Renderers and chain where nothing is plane: along z as along x, and on a surface that lies askew.
#include "client/render/contact_frame.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <vector>

#include "client/render/force_chain.h"
#include "client/render/kalman_renderer.h"
#include "client/render/renderers.h"
#include "tests/render/analytic_tissue.h"

namespace teletact::client {
namespace {

using test::AnalyticTissue;

AnalyticTissue solid_tissue() {
  AnalyticTissue tissue;
  tissue.solid = true;
  return tissue;
}

TEST(ContactFrame, OnALevelSurfaceItsAxesAreTheScenes) {
  const ContactFrame frame(Vector3::UnitY());
  const Vector3 v(0.123456789, -9.87654321e-7, 3.3e12);
  EXPECT_EQ(frame.to_contact(v), v);
  EXPECT_EQ(frame.to_scene(v), v);
  const Matrix3 m = Matrix3::Random();
  EXPECT_EQ(frame.tensor_to_contact(m), m);
}

TEST(ContactFrame, AxesAreARotationOntoTheNormal) {
  std::vector<Vector3> normals{Vector3::UnitX(), -Vector3::UnitX(), Vector3::UnitZ(), -Vector3::UnitY(),
                               Vector3(1e-12, -1, 0).normalized()};
  for (int n = 0; n < 100; ++n) normals.push_back(Vector3::Random().normalized());
  for (const Vector3& normal : normals) {
    const ContactFrame frame(normal);
    Matrix3 axes;
    for (int i = 0; i < 3; ++i) axes.col(i) = frame.to_scene(Vector3::Unit(i));
    EXPECT_LE((axes.transpose() * axes - Matrix3::Identity()).norm(), 1e-6) << normal.transpose();
    EXPECT_NEAR(axes.determinant(), 1, 1e-6) << normal.transpose();
    EXPECT_LE((axes.col(1) - normal).norm(), 1e-15) << normal.transpose();
    const Vector3 v = Vector3::Random();
    EXPECT_LE((frame.to_contact(frame.to_scene(v)) - v).norm(), 1e-6);
  }
}

// The way of a finger that presses, draws a loop with both lateral components, and lifts.
Vector3 place(double t) {
  const double depth_m = std::min(0.03 * t, std::min(0.004, 0.03 * (1.2 - t))) - 0.001;
  return {0.03 + 0.004 * std::cos(9 * t), depth_m, 0.004 * std::sin(7 * t)};
}

ToolPose pose_at(double t) {
  return {place(t), (place(t) - place(t - 0.001)) / 0.001};
}

// Whatever is felt is felt the same way when tissue, finger and surface are turned and moved together.
TEST(Renderers, FeelTissueThatLiesAskewAsTissueThatLiesLevel) {
  const AnalyticTissue tissue = solid_tissue();
  const Matrix3 turn = Eigen::AngleAxisd(0.7, Vector3(1, 0.2, -0.4).normalized()).toRotationMatrix();
  const Vector3 moved(0.02, -0.03, 0.05);
  for (const std::string& name : renderer_names()) {
    const auto level = make_renderer(name, 0.001), askew = make_renderer(name, 0.001);
    ForceChain level_chain({}), askew_chain({});
    double largest_n = 0, largest_lateral_n = 0;
    for (int tick = 0; tick < 1200; ++tick) {
      const double t = 1e-3 * tick;
      const ToolPose pose = pose_at(t);
      const ToolPose turned{turn * pose.position_m + moved, turn * pose.velocity_m_s};
      ForceSample sample = tissue.told(pose.position_m, t, static_cast<std::uint64_t>(tick));
      ForceSample same = sample;
      same.position_m = turn * sample.position_m + moved;
      same.force_n = turn * sample.force_n;
      same.tangent_n_m = turn * sample.tangent_n_m * turn.transpose();
      same.surface.normal = turn.col(1);
      same.surface.offset_m = turn.col(1).dot(moved);
      if (tick % 4 == 0) level->update(sample, pose, t);
      if (tick % 4 == 0) askew->update(same, turned, t);
      ForceChainInput input;
      input.on = true;
      input.enabled_s = 10;
      input.period_s = 0.004;
      input.rendered = level->render(pose, t, level_chain.ledger());
      input.pose = pose;
      const Vector3 expected_n = level_chain.apply(input).force_n;
      input.rendered = askew->render(turned, t, askew_chain.ledger());
      input.pose = turned;
      input.surface = same.surface;
      const Vector3 felt_n = askew_chain.apply(input).force_n;
      ASSERT_LE((felt_n - turn * expected_n).norm(), 1e-6) << name << ' ' << tick;
      largest_n = std::max(largest_n, expected_n.norm());
      largest_lateral_n = std::max(largest_lateral_n, std::abs(expected_n.z()));
    }
    EXPECT_GT(largest_n, 0.3) << name;
    EXPECT_GT(largest_lateral_n, 0.03) << name;
  }
}

// As along x (kalman_renderer_test): over round inclusions, across them and aslant.
TEST(KalmanRenderer, FollowsRoundInclusionsBothWays) {
  const AnalyticTissue tissue = solid_tissue();
  for (const Vector3& way : {Vector3(0, 0, 1), Vector3(0, 0, -1), Vector3(0.6, 0, 0.8)}) {
    KalmanRenderer kalman;
    std::vector<double> errors;
    for (int tick = -250; tick < 250; ++tick) {
      const double t = 1e-3 * (tick + 250);
      const Vector3 at_m = Vector3(0.032, 0.004, 0) + 0.12e-3 * tick * way;
      if (tick % 4 == 0) kalman.update(tissue.answer(at_m, t), {at_m, Vector3::Zero()}, t);
      const Vector3 ahead_m = at_m + 0.12 * 0.003 * way;  // as old as an answer is
      const Vector3 truth_n = tissue.answer(ahead_m).force_n;
      if (tick > -200)
        errors.push_back((kalman.render({ahead_m, Vector3::Zero()}, t).force_n - truth_n).norm() /
                         truth_n.norm());
    }
    std::sort(errors.begin(), errors.end());
    EXPECT_LE(errors[errors.size() / 2], 0.015) << way.transpose();
    EXPECT_LE(errors[errors.size() * 95 / 100], 0.05) << way.transpose();
  }
}

// A plane scene's tissue gives no force across its plane, wherever the finger moves.
TEST(Renderers, PlaneTissueGivesNoForceAcross) {
  const AnalyticTissue tissue;
  for (const std::string& name : renderer_names()) {
    const auto renderer = make_renderer(name, 0.001);
    for (int tick = 0; tick < 1000; ++tick) {
      const double t = 1e-3 * tick;
      const ToolPose pose = pose_at(t);
      if (tick % 4 == 0) renderer->update(tissue.told(pose.position_m, t, 1), pose, t);
      const Rendered felt = renderer->render(pose, t);
      EXPECT_EQ(felt.force_n.z(), 0) << name << ' ' << tick;
      EXPECT_EQ(felt.lateral_stiffness_n_m.y(), 0) << name << ' ' << tick;
    }
  }
}

}  // namespace
}  // namespace teletact::client
