// What is felt by a law, and where answers are felt instead.
#include "client/render/law_renderer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "tests/render/law_rendering.h"

namespace teletact::client {
namespace {

using test::answer_at;
using test::at;
using test::law_of;
using test::Rendering;
using test::stiffness_at;

TEST(LawRenderer, FeelsTheTissueWhereTheFingerIsWithoutNewAnswers) {
  Rendering law;
  law.renderer.take_law(law_of(3));
  law.answer(0.01, -0.001, 3);
  double d = -0.001;
  for (double x = 0.01; x < 0.05; x += 1.2e-4) {
    d = std::min(d + 5e-5, 0.003);
    const Rendered rendered = law.tick(x, d);
    EXPECT_TRUE(rendered.by_law);
    if (d <= 1e-3) continue;
    const Vector3 expected_n = answer_at(x, d, 3, 1, 0).force_n;
    EXPECT_NEAR((rendered.force_n - expected_n).norm(), 0, 0.01 * expected_n.norm()) << x;
    EXPECT_NEAR(rendered.stored_j, stiffness_at(x, 3) * std::pow(d, 2.5), 0.01 * rendered.stored_j);
  }
}

TEST(LawRenderer, WithoutALawItIsTheKalmanFilter) {
  Rendering law;
  KalmanRenderer kalman;
  EnergyLedger ledger;
  for (int k = 0; k < 2000; ++k) {
    const double x = 0.01 + 2e-5 * k, d = 0.002 * std::sin(2e-3 * k);
    if (k % 20 == 0) {
      law.answer(x, d, 3);
      kalman.update(answer_at(x, d, 3, law.sequence, law.time_s), at(x, d), law.time_s);
    }
    ledger.earn(1e-6);
    if (!(d > 0)) ledger.reset();
    const Rendered one = law.tick(x, d, 1e-6), other = kalman.render(at(x, d), law.time_s, ledger);
    ASSERT_EQ(one.force_n, other.force_n) << k;
    ASSERT_EQ(one.stored_j, other.stored_j) << k;
    ASSERT_FALSE(one.by_law);
  }
}

// Press on the stiff place, slide off it, let go, and back outside of the tissue: nothing is gained or lost,
// though the display's largest stiffness is reached. A cap on the force would give back half of what it
// holds.
TEST(LawRenderer, ALoopThroughTheCapsGivesNothing) {
  LawRendererOptions options;
  options.largest_stiffness_n_m = 150, options.largest_force_n = 0.35;
  Rendering law(options);
  law.renderer.take_law(law_of(3));
  law.answer(0.03, -0.001, 3);
  double work_j = 0, largest_n = 0, x = 0.03, d = -1e-5, held_j = 0;
  Vector3 last_n = Vector3::Zero();
  const auto move = [&](double to_x, double to_d) {
    constexpr int kSteps = 20000;
    const double from_x = x, from_d = d;
    for (int k = 1; k <= kSteps; ++k) {
      const double was_x = x, was_d = d;
      x = from_x + (to_x - from_x) * k / kSteps, d = from_d + (to_d - from_d) * k / kSteps;
      const Rendered rendered = law.tick(x, d);
      EXPECT_LE(rendered.force_n.norm(), std::min(150 * std::max(d, 0.0), 0.35) * (1 + 1e-9));
      const Vector3 mean_n = (last_n + rendered.force_n) / 2;
      work_j += mean_n.x() * (x - was_x) + mean_n.y() * (d - was_d);
      largest_n = std::max(largest_n, rendered.force_n.norm());
      held_j = std::max(held_j, rendered.stored_j);
      last_n = rendered.force_n;
    }
  };
  move(0.03, 0.004), move(0.055, 0.004), move(0.055, -1e-5);
  EXPECT_GT(largest_n, 0.3);  // the caps are reached
  EXPECT_NEAR(work_j / held_j, 0, 2e-3);
}

// Nothing is dissipated: a softer law is felt within a fifth of a second, a harder one's surplus is withheld.
TEST(LawRenderer, NewLawUnderAFingerIsFeltGradually) {
  for (const double after : {0.5, 6.0}) {
    Rendering law;
    law.renderer.take_law(law_of(3, 1));
    law.answer(0.03, -0.001, 3);
    Rendered before;
    for (double d = -0.001; d < 0.003; d += 1e-5) before = law.tick(0.03, d, 0);
    before = law.tick(0.03, 0.003, 0);
    const double pressed_n = before.force_n.norm();
    law.renderer.take_law(law_of(after, 2));
    for (int k = 0; k < 200; ++k) {
      const Rendered now = law.tick(0.03, 0.003, 0);
      ASSERT_LT((now.force_n - before.force_n).norm(), 0.07 * before.force_n.norm());
      ASSERT_LE(now.force_n.norm(), pressed_n * (1 + 1e-9));
      before = now;
    }
    if (after < 3) {
      const Vector3 expected_n = answer_at(0.03, 0.003, after, 1, 0).force_n;
      EXPECT_NEAR((before.force_n - expected_n).norm(), 0, 0.01 * expected_n.norm());
    } else {
      EXPECT_NEAR(before.withheld, 1 - stiffness_at(0.03, 3) / stiffness_at(0.03, after),
                  0.02);  // the display's stiffness is felt in it
      for (int k = 0; k < 400; ++k) before = law.tick(0.03, 0.003, 1e-5);  // now it is paid for
      EXPECT_EQ(before.withheld, 0);
    }
  }
}

TEST(LawRenderer, WhereAnswersFeelNothingTheLawIsNotFelt) {
  Rendering law;
  law.renderer.take_law(law_of(3));
  law.answer(0.03, 0.002, 3);
  EXPECT_TRUE(law.tick(0.03, 0.002).by_law);
  ForceSample nothing = answer_at(0.03, 0.002, 3, 2, law.time_s, 0);  // of no window: not covered
  nothing.contact = false, nothing.force_n.setZero();
  law.renderer.update(nothing, at(0.03, 0.002), law.time_s);
  EXPECT_FALSE(law.tick(0.03, 0.002).by_law);
  law.sequence = 2;
  law.answer(0.03, 0.002, 3);
  EXPECT_TRUE(law.tick(0.03, 0.002).by_law);
  nothing.model_version = 1;  // of its window, and without force
  for (int k = 0; k < 4; ++k) law.renderer.update(nothing, at(0.03, 0.002), law.time_s);
  EXPECT_FALSE(law.tick(0.03, 0.002).by_law);
}

TEST(LawRenderer, DeeperThanTheLawWasSampledItIsTheFilter) {
  Rendering law;
  law.renderer.take_law(law_of(0));
  law.answer(0.03, 0.007, 0);
  EXPECT_TRUE(law.tick(0.03, 0.0079).by_law);
  EXPECT_FALSE(law.tick(0.03, 0.0081).by_law);
}

TEST(LawRenderer, ALawThatComesAsTheFingerTouchesDownIsFeltAtOnce) {
  Rendering touch;
  touch.answer(0.03, -0.001, 1);
  touch.tick(0.03, -0.0001, 0);
  touch.renderer.take_law(law_of(1));
  Rendered felt;
  for (double d = 0.0001; d < 0.004; d += 0.0001) felt = touch.tick(0.03, d, 0);
  EXPECT_TRUE(felt.by_law);
  EXPECT_EQ(felt.withheld, 0);
  EXPECT_GT(felt.force_n.norm(), 0.3);
}

// A law is of x and the depth along y.
TEST(LawRenderer, OnASurfaceThatLiesAskewItIsTheFilter) {
  for (const bool askew : {false, true}) {
    Rendering law;
    law.renderer.take_law(law_of(3));
    ForceSample sample = answer_at(0.03, -0.001, 3, 1, 0);
    if (askew) sample.surface.normal = Vector3(0.02, 1, 0).normalized();
    law.renderer.update(sample, at(0.03, -0.001), 0);
    EXPECT_EQ(law.tick(0.03, 0.001).by_law, !askew);
  }
}

TEST(LawRenderer, BesideTheLawAndOnAnotherLayerItIsTheFilter) {
  Rendering law;
  law.renderer.take_law(law_of(3));
  law.answer(0.03, -0.001, 3);
  EXPECT_TRUE(law.tick(0.03, 0.001).by_law);
  EXPECT_FALSE(law.tick(0.07, 0.001).by_law);
  NearLaw deeper = law_of(3);
  deeper.layer_depth_m = 0.005;
  law.renderer.take_law(deeper);
  EXPECT_FALSE(law.tick(0.03, 0.001).by_law);
}

// U = 600 exp(20 z) d^2.5 in two lanes, 12 mm apart.
NearLaw across_law() {
  NearLaw law;
  for (const double z_m : {0.0, 0.012})
    for (const double x_m : {0.0, 0.03, 0.06}) {
      LawColumn& column = law.columns[law.count++];
      column.x_m = x_m, column.z_m = z_m;
      column.of_area = true;
      column.version = 1;
      column.error_share = 0.005F, column.error_n = 0.001F;
      for (const double d : {3e-4, 8e-3}) {
        column.log_depth[column.rows] = float(std::log(d));
        column.samples[column.rows++] = {float(std::log(600) + 20 * z_m + 2.5 * std::log(d)), 0, 2.5F, 0, 20};
      }
    }
  return law;
}

TEST(LawRenderer, OfASolidFeelsTheForceAcross) {
  LawRenderer renderer;
  ForceSample sample = answer_at(0.03, 0.002, 0, 1, 0);
  const double z_m = 0.004;
  const auto resistance_at = [](double z, double d) {
    const double k = 600 * std::exp(20 * z);
    return Vector3(0, 2.5 * k * std::pow(d, 1.5), 20 * k * std::pow(d, 2.5));
  };
  const auto answer = [&](const Vector3& force_n, double x_m) {
    sample.position_m = {x_m, 0.002, z_m};
    sample.force_n = force_n;
    ++sample.sequence;
    renderer.update(sample, {sample.position_m, Vector3::Zero()}, 1e-3 * double(sample.sequence));
  };
  const auto felt = [&](double z, double d) { return renderer.render({{0.03, d, z}, Vector3::Zero()}, 1); };
  answer(-resistance_at(z_m, 0.002), 0.03);
  renderer.take_law(across_law());
  felt(z_m, -0.001);
  for (const double z : {0.001, 0.006, 0.011}) {
    const Rendered rendered = felt(z, 0.002);
    ASSERT_TRUE(rendered.by_law);
    EXPECT_LT((rendered.force_n + resistance_at(z, 0.002)).norm(), 0.02 * resistance_at(z, 0.002).norm())
        << z;
    felt(z, -0.001);
  }
  EXPECT_FALSE(felt(0.013, 0.002).by_law) << "beside the lanes";
  // Answers without the part across contradict it, those with it do not.
  for (int k = 0; k < 10; ++k) answer(-resistance_at(z_m, 0.002), 0.02 + 0.002 * k);
  EXPECT_EQ(renderer.dropped(), 0u);
  for (int k = 0; k < 10; ++k)
    answer(Vector3(0, 1, 0).cwiseProduct(-1.0 * resistance_at(z_m, 0.002)) + Vector3(0, 0, 0.05),
           0.02 + 0.002 * k);
  EXPECT_EQ(renderer.dropped(), 1u);
}

}  // namespace
}  // namespace teletact::client
