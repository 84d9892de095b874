// What a touch asks for and must not wait for: layers made ready elsewhere.
#include <gtest/gtest.h>

#include <cmath>
#include <deque>
#include <thread>

#include "service/base/choices.h"
#include "service/device/device.h"
#include "service/scene/scenes.h"
#include "service/touch_plane/touch_session.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

// Two windows, [0.03, 0.06) and [0.06, 0.09) m; what touches ask for waits here until it is told to go on.
class TouchedLater : public testing::Test {
 protected:
  TouchedLater() {
    for (const double x_m : {0.03, 0.06}) publish(x_m, 10e3);
    scene->set_touch_work(
        [this](const std::string&, std::function<void()> job) { preparing.push_back(std::move(job)); });
  }
  void publish(double x_m, double modulus_pa) {
    scene->publish(window_of(homogeneous(modulus_pa), x_m, 0.03, 0.03));
  }
  static std::size_t do_all(std::deque<std::function<void()>>& jobs) {
    std::size_t done = 0;
    for (; !jobs.empty(); ++done) {
      const auto job = std::move(jobs.front());
      jobs.pop_front();
      job();
    }
    return done;
  }
  static TouchOptions inside() {
    TouchOptions options;
    options.layer_depth_m = 0.010;
    return options;
  }
  static void expect_preparing(const TouchAnswer& answer) {
    EXPECT_EQ(answer.status, TouchStatus::kPreparing);
    EXPECT_EQ(answer.contact.force_n[0], 0);
    EXPECT_EQ(answer.contact.force_n[1], 0);
    EXPECT_NE(answer.window_id, 0U);
    EXPECT_NE(answer.warning.find("made ready"), std::string::npos) << answer.warning;
    EXPECT_FALSE(answer.foreseen.has_value());
  }
  std::shared_ptr<Scene> scene = std::make_shared<Scene>("s", tissue(0.12, 0.03), versions());
  std::deque<std::function<void()>> preparing;
};

TEST_F(TouchedLater, AnInteriorLayerIsNeverMadeByTheTouch) {
  TouchSession session(scene, inside(), nullptr);
  EXPECT_TRUE(preparing.empty());  // opening asks for nothing yet: where the finger is, is not known
  for (int k = 0; k < 3; ++k) expect_preparing(session.solve({0.045, 0.012}));
  EXPECT_EQ(preparing.size(), 1U) << "asked for once";
  EXPECT_FALSE(tissue_of(*scene->snapshot()->windows[0]).ready(10));
  do_all(preparing);
  const TouchAnswer answer = session.solve({0.045, 0.012});
  EXPECT_EQ(answer.status, TouchStatus::kOk) << answer.warning;
  EXPECT_LT(answer.contact.force_n[1], 0);
  EXPECT_EQ(preparing.size(), 1U) << "the window that the finger may enter next";
  do_all(preparing);
  EXPECT_EQ(session.solve({0.075, 0.012}).status, TouchStatus::kOk);
}

TEST_F(TouchedLater, LayerOfTwoClientsIsMadeOnce) {
  TouchOptions annas = inside(), bertas = inside();
  annas.client = "anna", bertas.client = "berta";
  TouchSession anna(scene, annas, nullptr), berta(scene, bertas, nullptr);
  for (int k = 0; k < 3; ++k) expect_preparing(anna.solve({0.045, 0.012}));
  for (int k = 0; k < 3; ++k) expect_preparing(berta.solve({0.045, 0.012}));
  ASSERT_EQ(preparing.size(), 2U);
  preparing.back()();  // of berta
  const auto made = tissue_of(*scene->snapshot()->windows[0]).ready(10);
  EXPECT_NE(made, nullptr);
  preparing.front()();
  preparing.clear();
  EXPECT_EQ(tissue_of(*scene->snapshot()->windows[0]).ready(10), made);
  for (TouchSession* session : {&anna, &berta})
    EXPECT_EQ(session->solve({0.045, 0.012}).status, TouchStatus::kOk);
}

TEST_F(TouchedLater, AnotherWindowThatIsNotReadyIsSaidAndHasNoForce) {
  TouchSession session(scene, inside(), nullptr);
  session.solve({0.045, 0.012});
  do_all(preparing);
  EXPECT_EQ(session.solve({0.045, 0.012}).status, TouchStatus::kOk);
  expect_preparing(session.solve({0.075, 0.012}));  // before its job was done
  do_all(preparing);
  EXPECT_EQ(session.solve({0.075, 0.012}).status, TouchStatus::kOk);
}

TEST_F(TouchedLater, NewModelsHaveTheLayersInUse) {
  TouchSession surface(scene, {}, nullptr);
  EXPECT_EQ(surface.solve({0.045, 0.002}).status, TouchStatus::kOk);
  EXPECT_TRUE(preparing.empty());
  TouchSession session(scene, inside(), nullptr);
  session.solve({0.045, 0.012});
  do_all(preparing);
  const TouchAnswer before = session.solve({0.045, 0.012});
  publish(0.03, 20e3);
  const TouchAnswer after = session.solve({0.045, 0.012});
  EXPECT_EQ(after.status, TouchStatus::kOk);
  EXPECT_GT(after.model_version, before.model_version);
}

TEST_F(TouchedLater, OldGradientModelAnswersUntilTheNewIsReady) {
  TouchOptions options;
  options.path = SolvePath::kGradients;
  TouchSession session(scene, options, Device::open());
  expect_preparing(session.solve({0.045, -0.001}));
  do_all(preparing);
  const TouchAnswer before = session.solve({0.045, -0.001});
  EXPECT_EQ(before.status, TouchStatus::kOk);
  publish(0.03, 20e3);
  const TouchAnswer meanwhile = session.solve({0.045, -0.001});
  EXPECT_EQ(meanwhile.status, TouchStatus::kOk);
  EXPECT_EQ(meanwhile.model_version, before.model_version);
  do_all(preparing);
  EXPECT_GT(session.solve({0.045, -0.001}).model_version, before.model_version);
}

TEST_F(TouchedLater, UnknownGradientLayerSaysWhatItWants) {
  const TouchWay way{.path = SolvePath::kGradients, .device = Device::open()};
  const auto layer = scene->snapshot()->windows[0]->model->layer({}, way, {});
  const TouchPose pressed{{0.045, 0.002, 0}};
  EXPECT_FALSE(layer->wanted({}, {{0.045, -0.001, 0}}, 0)) << "above";
  const ContactAnswer nothing = layer->answer({}, pressed);
  EXPECT_TRUE(std::isinf(nothing.solve.relative_error) && !nothing.solve.converged);
  const auto job = layer->wanted({}, pressed, 0);
  ASSERT_TRUE(job);
  EXPECT_EQ(job->wait, JobWait::kFirst);
  EXPECT_FALSE(job->work(TouchedLayer::Clock::now())) << "no time for a step";
  EXPECT_TRUE(job->work(TouchedLayer::Clock::time_point::max()));
  EXPECT_FALSE(layer->wanted({}, pressed, 0));
  EXPECT_LT(layer->answer({}, pressed).force_n[1], 0);
  EXPECT_TRUE(layer->wanted({}, pressed, choices::kWidestReach)) << "what it may touch next";
}

TEST_F(TouchedLater, DeviceFailureDuringGradientsIsSaid) {
  TouchOptions options;
  options.path = SolvePath::kGradients;
  TouchSession session(scene, options, Device::open());
  expect_preparing(session.solve({0.045, 0.002}));
  fail_launches(true);
  do_all(preparing);
  const TouchAnswer answer = session.solve({0.045, 0.002});
  fail_launches(false);
  EXPECT_EQ(answer.status, TouchStatus::kFailed);
  EXPECT_TRUE(answer.device_failed) << answer.warning;
}

}  // namespace
}  // namespace teletact::service
