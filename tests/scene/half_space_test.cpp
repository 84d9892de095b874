// Another kind of model through scene and session: nothing there may know of plane strain.
#include "tests/scene/half_space.h"

#include <gtest/gtest.h>

#include "service/base/choices.h"
#include "service/device/device.h"
#include "service/touch_plane/touch_session.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

constexpr double kWidthM = 0.1, kDepthM = 0.04, kModulusPa = 10e3;

class OnAHalfSpace : public testing::Test {
 protected:
  static std::shared_ptr<Scene> scene_of(const HalfSpaces& models) {
    return std::make_shared<Scene>("s", tissue(kWidthM, kDepthM),
                                   ExplicitModulus{{0, kWidthM}, {0, kDepthM}, {kModulusPa}}, versions(),
                                   Limits{}, MemoryAccount{}, std::make_shared<const HalfSpaces>(models));
  }
  std::shared_ptr<Scene> scene = scene_of(HalfSpaces{});
};

TEST_F(OnAHalfSpace, ForceAndTangentHaveThreeComponents) {
  TouchSession session(scene, {}, nullptr);
  const double nu = scene->geometry().poisson_ratio, radius_m = Fingertip{}.radius_m, d = 0.003;
  const Vector3 n = tilted_surface().normal;
  const TouchAnswer answer = session.solve(on_tilted_surface(0.03, 0.012, d));
  ASSERT_EQ(answer.status, TouchStatus::kOk) << answer.warning;
  const double hertz_n = 4.0 / 3 * kModulusPa / (1 - nu * nu) * std::sqrt(radius_m * d * d * d);
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_NEAR(answer.contact.force_n[k], -hertz_n * n[k], 1e-9 * hertz_n);
    EXPECT_LT(answer.contact.force_n[k], 0);
  }
  EXPECT_LE(answer.contact.solve.relative_error, 1e-14);
}

TEST_F(OnAHalfSpace, ForceAndTangentAreGradientsOfTheEnergy) {
  TouchSession session(scene, {}, nullptr);
  const Vector3 at = on_tilted_surface(0.06, -0.02, 0.002);
  const ContactAnswer here = session.solve(at).contact;
  constexpr double kStepM = 1e-6;
  for (std::size_t k = 0; k < 3; ++k) {
    Vector3 before = at, after = at;
    before[k] -= kStepM, after[k] += kStepM;
    const ContactAnswer a = session.solve(before).contact, b = session.solve(after).contact;
    EXPECT_NEAR(here.force_n[k], -(b.energy_j - a.energy_j) / (2 * kStepM), 1e-5 * std::abs(here.force_n[1]));
    for (std::size_t i = 0; i < 3; ++i)
      EXPECT_NEAR(here.tangent_n_m[3 * i + k], (b.force_n[i] - a.force_n[i]) / (2 * kStepM),
                  1e-5 * std::abs(here.tangent_n_m[4]));
  }
}

TEST_F(OnAHalfSpace, TheLightTouchThatWaitsIsBelowAlongTheNormal) {
  TouchSession session(scene, {}, nullptr);
  const Vector3 above = on_tilted_surface(0.05, 0.01, -0.002);
  const TouchAnswer answer = session.solve(above);
  EXPECT_EQ(answer.contact.state, ContactState::kNoContact);
  ASSERT_TRUE(answer.foreseen.has_value());
  const Vector3 n = tilted_surface().normal;
  for (std::size_t k = 0; k < 3; ++k)
    EXPECT_NEAR(answer.foreseen->position_m[k], above[k] + (0.002 + choices::kLightTouch) * n[k], 1e-12);
  const TouchAnswer there = session.solve(answer.foreseen->position_m);
  for (std::size_t k = 0; k < 3; ++k)
    EXPECT_NEAR(answer.foreseen->contact.force_n[k], there.contact.force_n[k], 1e-9);
}

TEST_F(OnAHalfSpace, AnswerStandsWithoutRoomForTheNext) {
  const Vector3 at = on_tilted_surface(0.05, 0, 0.002);
  for (const auto full :
       {+[] { throw MemoryRefused("the budget"); }, +[] { throw DeviceMemoryError("the device"); },
        +[] { throw std::domain_error("the next place"); }}) {
    TouchSession session(scene_of(HalfSpaces({.ahead = full})), {}, nullptr);
    EXPECT_EQ(session.solve(at).status, TouchStatus::kOk);
    EXPECT_NO_THROW(session.look_ahead());
    EXPECT_EQ(session.solve(at).status, TouchStatus::kOk);
  }
  const auto failed = [] { throw DeviceError("it is gone"); };
  TouchSession session(scene_of(HalfSpaces({.ahead = failed})), {}, nullptr);
  EXPECT_EQ(session.solve(at).status, TouchStatus::kOk);
  EXPECT_THROW(session.look_ahead(), DeviceError);
}

TEST_F(OnAHalfSpace, WhatItCannotDoIsRefusedWhenTheTouchOpens) {
  const auto refused = [this](const TouchOptions& options, const std::string& field) {
    try {
      TouchSession(scene, options, nullptr);
      ADD_FAILURE() << field << " was taken";
    } catch (const std::invalid_argument& error) {
      EXPECT_EQ(std::string(error.what()).rfind(field + ": ", 0), 0U) << error.what();
    }
  };
  refused({.fingertip = {.shape = FingertipShape::kFlatPunch}}, "open.fingertip.shape");
  refused({.fingertip = {.friction = Friction::kStuck}}, "open.fingertip.shape");
  for (const double depth_m : {1e-4, 0.01, kDepthM})
    refused({.fingertip = {}, .layer_depth_m = depth_m}, "open.layer.depth_m");
  for (const SolvePath path : {SolvePath::kCompliance, SolvePath::kGradients, SolvePath::kShares})
    refused({.fingertip = {}, .path = path}, "open.path");
}

TEST_F(OnAHalfSpace, EdgesThatAreHeldAreRefused) {
  SceneGeometry held = tissue(kWidthM, kDepthM);
  held.supports.left = EdgeSupport::kFixed;
  const ExplicitModulus e{{0, kWidthM}, {0, kDepthM}, {kModulusPa}};
  EXPECT_THROW(HalfSpaces().of_modulus(held, e, {}), std::invalid_argument);
}

TEST_F(OnAHalfSpace, AnAnswerThatFailsNamesNoWayInWhichItWasSolved) {
  TouchSession session(scene_of(HalfSpaces({.stated_error = HUGE_VAL})), {}, nullptr);
  const TouchAnswer answer = session.solve(on_tilted_surface(0.05, 0, 0.001));
  EXPECT_EQ(answer.status, TouchStatus::kFailed);
  EXPECT_EQ(answer.path, SolvePath::kAuto);
  EXPECT_EQ(answer.contact.force_n, Vector3{});
}

TEST_F(OnAHalfSpace, ItsLastPlaceIsTouched) {
  TouchSession session(scene, {}, nullptr);
  EXPECT_EQ(session.solve(on_tilted_surface(kWidthM, 0, 0.001)).status, TouchStatus::kOk);
}

TEST_F(OnAHalfSpace, UncertainForceIsDegradedAndSaysWhy) {
  const Vector3 at = on_tilted_surface(0.05, 0, 0.001);
  EXPECT_EQ(TouchSession(scene_of(HalfSpaces({1e-3})), {}, nullptr).solve(at).status, TouchStatus::kOk);
  const TouchAnswer answer = TouchSession(scene_of(HalfSpaces({0.01})), {}, nullptr).solve(at);
  EXPECT_EQ(answer.status, TouchStatus::kDegraded);
  EXPECT_NE(answer.warning.find("up to 0.01"), std::string::npos) << answer.warning;
  EXPECT_EQ(answer.warning.find("stopped"), std::string::npos) << answer.warning;
}

TEST(PublishedHalfSpaces, AreTouchedAndReplacedAsAnyModel) {
  auto scene = std::make_shared<Scene>("s", tissue(kWidthM, kDepthM), versions(), Limits{}, MemoryAccount{},
                                       std::make_shared<const HalfSpaces>());
  TouchSession session(scene, {}, nullptr);
  const Vector3 at = on_tilted_surface(0.05, 0.01, 0.002);
  EXPECT_EQ(session.solve(at).status, TouchStatus::kNotCovered);
  scene->publish(window_of(homogeneous(10e3), 0.02, 0.06, kDepthM));
  const TouchAnswer soft = session.solve(at);
  EXPECT_EQ(soft.status, TouchStatus::kOk) << soft.warning;
  scene->publish(window_of(homogeneous(30e3), 0.02, 0.06, kDepthM));
  const TouchAnswer stiff = session.solve(at);
  EXPECT_GT(stiff.model_version, soft.model_version);
  for (std::size_t k = 0; k < 3; ++k)
    EXPECT_NEAR(stiff.contact.force_n[k] / soft.contact.force_n[k], 3, 1e-4);
}

}  // namespace
}  // namespace teletact::service
