#include "bench/stability/renderers.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace teletact::bench {
namespace {

using client::ForceSample;
using client::Rendered;
using client::ToolPose;
using client::Vector3;

constexpr double kDepthM = 0.004;
const ToolPose kTool{Vector3(0, kDepthM, 0), Vector3::Zero()};

ForceSample pressed(double force_n, double time_s) {
  ForceSample sample;
  sample.contact = true;
  sample.pose_time_s = time_s;
  sample.position_m = Vector3(0, kDepthM, 0);
  sample.force_n = Vector3(0, -force_n, 0);
  sample.tangent_n_m(1, 1) = -force_n / kDepthM;
  return sample;
}

TEST(InterpolatingRenderer, ForceGoesStraightBetweenAnswers) {
  InterpolatingRenderer renderer;
  renderer.update(pressed(1.0, 0), kTool, 0.00);
  renderer.update(pressed(1.0, 0.02), kTool, 0.02);
  renderer.update(pressed(2.0, 0.04), kTool, 0.04);
  for (const double share : {0.0, 0.25, 0.5, 1.0, 3.0}) {
    const Rendered rendered = renderer.render(kTool, 0.04 + 0.02 * share);
    const double expected_n = 1 + std::min(share, 1.0);
    EXPECT_NEAR(rendered.force_n.y(), -expected_n, 1e-12) << share;
    EXPECT_NEAR(rendered.stiffness_n_m, expected_n / kDepthM, 1e-9) << share;
    EXPECT_NEAR(rendered.gain, std::min(share, 1.0), 1e-12) << share;
  }
}

TEST(InterpolatingRenderer, ForceOnARampIsOnePeriodOld) {
  InterpolatingRenderer renderer;
  constexpr double kPeriodS = 0.02, kSlopeNS = 3;
  for (int n = 0; n < 500; ++n) {
    const double time_s = 0.001 * n;
    if (n % 20 == 0) renderer.update(pressed(kSlopeNS * time_s, time_s), kTool, time_s);
    if (n < 60) continue;
    EXPECT_NEAR(-renderer.render(kTool, time_s).force_n.y(), kSlopeNS * (time_s - kPeriodS), 1e-9) << n;
  }
}

TEST(InterpolatingRenderer, EarlyAnswerDoesNotStepTheForce) {
  InterpolatingRenderer renderer;
  renderer.update(pressed(1, 0), kTool, 0);
  renderer.update(pressed(3, 0.02), kTool, 0.02);
  const double before_n = renderer.render(kTool, 0.03).force_n.y();
  renderer.update(pressed(0.5, 0.03), kTool, 0.03);
  EXPECT_NEAR(renderer.render(kTool, 0.03).force_n.y(), before_n, 1e-12);
}

TEST(InterpolatingRenderer, LostContactIsZeroAfterAPeriod) {
  InterpolatingRenderer renderer;
  renderer.update(pressed(1, 0), kTool, 0);
  renderer.update({}, kTool, 0.02);
  EXPECT_NEAR(renderer.render(kTool, 0.03).force_n.y(), -0.5, 1e-12);
  EXPECT_EQ(renderer.render(kTool, 0.04).force_n.norm(), 0);
}

TEST(HoldRenderer, HoldsTheLastForceAndDropsItOffContact) {
  HoldRenderer renderer;
  renderer.update(pressed(0.8, 0), kTool, 0);
  EXPECT_NEAR(renderer.render({Vector3(0, 0.001, 0), Vector3::Zero()}, 5).force_n.y(), -0.8, 1e-12);
  EXPECT_NEAR(renderer.render(kTool, 5).stiffness_n_m, 200, 1e-9);
  renderer.update({}, kTool, 6);
  EXPECT_EQ(renderer.render(kTool, 6).force_n.norm(), 0);
}

TEST(Renderers, EachIsMadeByItsNameAndReportsItsGain) {
  for (const std::string& name : renderer_names()) {
    const auto renderer = make_any_renderer(name, 0.001);
    EXPECT_EQ(renderer->render(kTool, 0).force_n.norm(), 0) << name;
    double time_s = 0;
    for (int n = 0; n < 20; ++n, time_s += 0.01)
      renderer->update(pressed(1 + 0.2 * (n % 2), time_s), kTool, time_s);
    const Rendered rendered = renderer->render(kTool, time_s);
    EXPECT_GT(rendered.force_n.norm(), 0.9) << name;
    EXPECT_GT(rendered.gain, 0) << name;
    EXPECT_LE(rendered.gain, 1) << name;
  }
  EXPECT_THROW(make_any_renderer("mirror", 0.001), std::invalid_argument);
}

}  // namespace
}  // namespace teletact::bench
