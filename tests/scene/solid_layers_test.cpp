// Layers of a solid below its surface: listed, made ready, kept, touched, refused.
#include <gtest/gtest.h>

#include <functional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "tests/scene/solid_with_ball.h"

namespace teletact::service {
namespace {

// Rows of nodes 3 mm apart, the last one held.
TEST(SolidLayers, AreTouchedAsTheSurfaceIs) {
  const auto scene = scene_of(with_ball());
  const auto layers = scene->snapshot()->windows.front()->model->layers();
  ASSERT_EQ(layers.size(), 10u);
  TouchOptions options;
  options.layer_depth_m = 0.0065;  // 2.5 mm above the ball's middle
  TouchSession session(scene, options, test_device()), surface(scene, {}, test_device());
  EXPECT_EQ(session.layer(), layers[2]) << "the nearest";
  const double depth_m = layers[2].depth_m;
  EXPECT_NEAR(depth_m, 0.006, 1e-12);
  const TouchAnswer over = touched(session, kBallX, depth_m + 0.002, kBallZ);
  ASSERT_EQ(over.status, TouchStatus::kOk) << over.warning;
  EXPECT_LE(over.contact.solve.relative_error, choices::kSolidForceError);
  for (const NodalPressure& p : over.contact.pressure) EXPECT_DOUBLE_EQ(p.position_m[1], depth_m);
  const TouchAnswer beside = touched(session, 0.008, depth_m + 0.002, kBallZ);
  EXPECT_GT(over.contact.force_n[1] / beside.contact.force_n[1], 1.3) << "nearer to the ball than above it";
  const TouchAnswer top = touched(surface, kBallX, 0.002, kBallZ);
  EXPECT_EQ(top.status, TouchStatus::kOk) << top.warning;
  EXPECT_GT(over.contact.force_n[1] / top.contact.force_n[1], 1.3);
  const TouchAnswer above = touched(session, kBallX, depth_m - 0.001, kBallZ);
  EXPECT_EQ(above.status, TouchStatus::kOk) << above.warning;
  EXPECT_EQ(above.contact.state, ContactState::kNoContact) << "the tip is inside, above its layer";
}

// It is made ready once, kept while it is touched, and the one that was made last beyond that.
TEST(SolidLayers, AreKeptWhileTheyAreTouched) {
  const auto scene = scene_of(with_ball());
  const auto model = scene->snapshot()->windows.front()->model;
  TouchWay way;
  way.device = test_device();
  std::vector<std::function<void()>> asked;
  const TouchWork later = [&](const std::string&, std::function<void()> job) {
    asked.push_back(std::move(job));
  };
  const auto get = [&](std::size_t row) { return model->layer(model->layers()[row], way, later); };
  const auto do_it = [&] {
    for (const auto& job : std::exchange(asked, {})) job();
  };
  EXPECT_EQ(get(2), nullptr) << "its surface is made ready first";
  do_it();
  EXPECT_EQ(get(2), nullptr);
  EXPECT_EQ(get(2), nullptr);
  EXPECT_EQ(asked.size(), 1u) << "asked for once";
  do_it();
  const auto held = get(2);
  ASSERT_NE(held, nullptr);
  EXPECT_NE(get(2), nullptr);
  EXPECT_EQ(get(4), nullptr);
  do_it();
  EXPECT_NE(get(4), nullptr) << "made last";
  EXPECT_NE(get(2), nullptr) << "held";
  EXPECT_EQ(get(6), nullptr);
  do_it();
  EXPECT_NE(get(2), nullptr);
  EXPECT_TRUE(asked.empty());
  EXPECT_EQ(get(4), nullptr) << "given back";
  EXPECT_EQ(asked.size(), 1u);
  EXPECT_THROW(model->layer(Layer{kDepthM}, way, later), std::out_of_range) << "held by the bottom";
  EXPECT_THROW(model->layer(Layer{0.0065}, way, later), std::out_of_range) << "no row of nodes";
}

// A slice takes the surface over at once; a layer below it follows, and then feels what the slice has shown.
TEST(SolidLayers, FeelANewSlice) {
  const auto scene = scene_of(stack({-0.01, 0.01}));
  TouchOptions options;
  options.layer_depth_m = 0.003;
  TouchSession session(scene, options, test_device());
  const auto force = [&](TouchSession& finger) {
    TouchAnswer a = touched(finger, kBallX, 0.005, kBallZ);
    for (int rests = 0; rests < 2000 && !a.contact.solve.converged; ++rests) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
      a = touched(finger, kBallX, 0.005, kBallZ);
    }
    EXPECT_TRUE(a.contact.solve.converged);
    EXPECT_EQ(a.model_version, scene->snapshot()->version);
    return -a.contact.force_n[1];
  };
  const double soft = force(session);
  scene->publish(slice_at(kBallZ));
  const double hard = force(session);
  EXPECT_GT(hard, 1.1 * soft);
  TouchSession fresh(scene_of(stack({-0.01, kBallZ, 0.01})), options, test_device());
  const TouchAnswer truth = touched(fresh, kBallX, 0.005, kBallZ);
  ASSERT_TRUE(truth.contact.solve.converged);
  EXPECT_NEAR(hard, -truth.contact.force_n[1],
              2 * choices::kSolidForceError * hard + choices::kMaxDrift * hard);
}

TEST(SolidLayers, AreRefusedWhereThereIsNone) {
  for (const double depth_m : {-0.001, 0.031, kDepthM}) {
    TouchOptions options;
    options.layer_depth_m = depth_m;
    try {
      const TouchSession session(scene_of(with_ball()), options, test_device());
      ADD_FAILURE() << depth_m << ": another was touched instead";
    } catch (const std::invalid_argument& error) {
      const std::string why = error.what();
      EXPECT_EQ(why.rfind("open.layer.depth_m: ", 0), 0u) << why;
      EXPECT_NE(why.find("; give a"), std::string::npos) << why;
    }
  }
}

}  // namespace
}  // namespace teletact::service
