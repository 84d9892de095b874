#include "client/render/law_renderer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>

namespace teletact::client {
namespace {

constexpr double kTickS = 0.001;

// U = k(x) d^2.5 with a stiff place at x = 30 mm; columns every 2 mm.
double stiffness_at(double x_m, double peak) {
  const double off = (x_m - 0.03) / 0.006;
  return 600 * (1 + peak * std::exp(-off * off));
}
double stiffness_slope(double x_m, double peak) {
  const double off = (x_m - 0.03) / 0.006;
  return -600 * peak * 2 * off / 0.006 * std::exp(-off * off);
}

NearLaw law_of(double peak, std::uint64_t version = 1) {
  NearLaw law;
  for (int i = 0; i <= 30; ++i) {
    LawColumn& column = law.columns[law.count++];
    column.x_m = 0.002 * i;
    column.version = version;
    column.error_share = 0.005F, column.error_n = 0.001F;
    const double k = stiffness_at(column.x_m, peak), slope = stiffness_slope(column.x_m, peak);
    for (const double d : {3e-4, 9e-4, 2.7e-3, 8e-3}) {
      column.log_depth[column.rows] = float(std::log(d));
      column.samples[column.rows++] = {float(std::log(k) + 2.5 * std::log(d)), float(slope / k), 2.5F, 0};
    }
  }
  return law;
}

ForceSample answer_at(double x_m, double d_m, double peak, std::uint64_t sequence, double time_s,
                      std::uint64_t version = 1) {
  ForceSample sample;
  sample.sequence = sequence, sample.model_version = version;
  sample.pose_time_s = time_s;
  sample.position_m = {x_m, d_m, 0};
  sample.contact = d_m > 0;
  const double k = stiffness_at(x_m, peak);
  if (sample.contact)
    sample.force_n = {-stiffness_slope(x_m, peak) * std::pow(d_m, 2.5), -2.5 * k * std::pow(d_m, 1.5), 0};
  return sample;
}

ToolPose at(double x_m, double d_m) {
  return {{x_m, d_m, 0}, Vector3::Zero()};
}

struct Rendering {
  explicit Rendering(const LawRendererOptions& options = {}) : renderer(options) {}
  Rendered tick(double x_m, double d_m, double dissipated_j = std::numeric_limits<double>::infinity()) {
    time_s += kTickS;
    return renderer.render(at(x_m, d_m), time_s, dissipated_j);
  }
  bool answer(double x_m, double d_m, double peak, std::uint64_t version = 1) {
    return renderer.update(answer_at(x_m, d_m, peak, ++sequence, time_s, version), at(x_m, d_m), time_s);
  }
  LawRenderer renderer;
  double time_s = 0;
  std::uint64_t sequence = 0;
};

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
  for (int k = 0; k < 2000; ++k) {
    const double x = 0.01 + 2e-5 * k, d = 0.002 * std::sin(2e-3 * k);
    if (k % 20 == 0) {
      law.answer(x, d, 3);
      kalman.update(answer_at(x, d, 3, law.sequence, law.time_s), at(x, d), law.time_s);
    }
    const Rendered one = law.tick(x, d, 1e-6), other = kalman.render(at(x, d), law.time_s, 1e-6);
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
TEST(LawRenderer, AnotherLawUnderAPressedFingerIsFeltGraduallyAndPaidFor) {
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

TEST(LawRenderer, ALawThatAnswersContradictIsDroppedAfterFourInARow) {
  Rendering law;
  law.renderer.take_law(law_of(3));
  law.answer(0.02, -0.001, 1);
  for (double d = -0.001; d < 0.002; d += 1e-5) law.tick(0.03, d);
  for (int k = 0; k < 3; ++k) {
    law.answer(0.03, 0.002, 1);  // half as stiff as the law says
    EXPECT_TRUE(law.tick(0.03, 0.002).by_law);
  }
  law.answer(0.03, 0.002, 3);  // one that agrees begins the count again
  for (int k = 0; k < 3; ++k) law.answer(0.03, 0.002, 1);
  const Rendered last = law.tick(0.03, 0.002);
  EXPECT_TRUE(last.by_law);
  law.answer(0.03, 0.002, 1);
  const Rendered dropped = law.tick(0.03, 0.002);
  EXPECT_FALSE(dropped.by_law);
  EXPECT_EQ(law.renderer.dropped(), 1u);
  EXPECT_LT((dropped.force_n - last.force_n).norm(), 0.07 * last.force_n.norm());
  // The filter's model takes over.
  Rendered now;
  for (int k = 0; k < 200; ++k) now = law.tick(0.03, 0.002);
  const Vector3 expected_n = answer_at(0.03, 0.002, 1, 1, 0).force_n;
  EXPECT_NEAR((now.force_n - expected_n).norm(), 0, 0.02 * expected_n.norm());
  // A newer version is another law.
  law.renderer.take_law(law_of(1, 2));
  law.answer(0.03, 0.002, 1, 2);
  EXPECT_TRUE(law.tick(0.03, 0.002).by_law);
}

// By half more than it states: in four places it is wrong, in one it may be a ripple.
TEST(LawRenderer, ALawThatIsOffByMoreThanItStatesIsDroppedWhereAFingerThatMovesFindsItSo) {
  for (const bool moves : {true, false}) {
    Rendering law;
    law.renderer.take_law(law_of(0));
    law.answer(0.02, -0.001, 0);
    for (int k = 0; k < 4; ++k) {
      const double x = 0.02 + (moves ? 0.002 * k : 1e-4 * k);
      EXPECT_TRUE(law.tick(x, 0.002).by_law);
      ForceSample sample = answer_at(x, 0.002, 0, ++law.sequence, law.time_s, 1);
      const double force_n = sample.force_n.norm();
      sample.force_n *= 1 + 1.5 * (0.005 * force_n + 0.001) / force_n;
      law.renderer.update(sample, at(x, 0.002), law.time_s);
    }
    EXPECT_EQ(law.tick(0.026, 0.002).by_law, !moves);
  }
}

// Windows of versions of their own, each found wrong in its turn: none of them is rendered again.
TEST(LawRenderer, LawsOfSeveralWindowsThatWereFoundWrongStayDropped) {
  Rendering law;
  NearLaw windows = law_of(3, 4);
  for (std::size_t i = 14; i < 17; ++i) windows.columns[i].version = 6;
  for (std::size_t i = 17; i < windows.count; ++i) windows.columns[i].version = 5;
  law.renderer.take_law(windows);
  const struct {
    double x_m;
    std::uint64_t version;
  } places[] = {{0.025, 4}, {0.031, 6}, {0.035, 5}};
  for (const auto& place : places) {
    law.answer(place.x_m, 0.002, 3, place.version);
    EXPECT_TRUE(law.tick(place.x_m, 0.002).by_law) << place.version;
    for (int k = 0; k < 4; ++k) law.answer(place.x_m, 0.002, 20, place.version);
  }
  EXPECT_EQ(law.renderer.dropped(), 3u);
  for (const auto& place : places) {
    law.answer(place.x_m, 0.002, 3, place.version);
    EXPECT_FALSE(law.tick(place.x_m, 0.002).by_law) << place.version;
  }
}

TEST(LawRenderer, AnOlderLawThanTheAnswersIsNotRendered) {
  Rendering law;
  law.renderer.take_law(law_of(3, 4));
  law.answer(0.03, -0.001, 3, 4);
  EXPECT_TRUE(law.tick(0.03, 0.001).by_law);
  law.answer(0.03, 0.001, 3, 5);
  EXPECT_FALSE(law.tick(0.03, 0.001).by_law);
  law.renderer.take_law(law_of(3, 5));
  EXPECT_TRUE(law.tick(0.03, 0.001).by_law);
}

// Windows have versions of their own: one that was published before its neighbour is no older law.
TEST(LawRenderer, AnOlderWindowBesideANewerOneIsRendered) {
  Rendering law;
  NearLaw windows = law_of(3, 4);
  for (std::size_t i = 16; i < windows.count; ++i) windows.columns[i].version = 7;
  law.renderer.take_law(windows);
  law.answer(0.04, 0.001, 3, 7);
  EXPECT_TRUE(law.tick(0.04, 0.001).by_law);
  EXPECT_TRUE(law.tick(0.02, 0.001).by_law);  // before an answer came of there
  law.answer(0.02, 0.001, 3, 4);
  EXPECT_TRUE(law.tick(0.02, 0.001).by_law);
  EXPECT_TRUE(law.tick(0.04, 0.001).by_law);
}

// Between the columns of two versions neither is right or wrong alone, however far they are apart.
TEST(LawRenderer, ABorderOfVersionsCondemnsNoLaw) {
  Rendering law;
  NearLaw mixed = law_of(3, 5);
  const NearLaw older = law_of(1, 4);
  std::copy_n(older.columns.begin(), 15, mixed.columns.begin());
  const LawValue border = evaluate(mixed.used(), 0.029, 0.002);
  ASSERT_GT(border.disagreement_n, 0.3 * std::hypot(border.by_x_n, border.by_d_n));
  law.renderer.take_law(mixed);
  EXPECT_TRUE(law.tick(0.029, 0.002).by_law);
  for (int k = 0; k < 10; ++k) law.answer(0.029, 0.002, 1, 5);
  EXPECT_TRUE(law.tick(0.029, 0.002).by_law);
  EXPECT_EQ(law.renderer.dropped(), 0u);
}

TEST(LawRenderer, WhatContradictsOneLawDoesNotCountAgainstAnother) {
  Rendering law;
  NearLaw windows = law_of(3, 4);
  for (std::size_t i = 16; i < windows.count; ++i) windows.columns[i].version = 7;
  law.renderer.take_law(windows);
  for (int k = 0; k < 3; ++k) law.answer(0.02, 0.002, 20, 4);
  for (int k = 0; k < 3; ++k) law.answer(0.04, 0.002, 20, 7);
  EXPECT_EQ(law.renderer.dropped(), 0u);
  law.answer(0.04, 0.002, 20, 7);
  EXPECT_EQ(law.renderer.dropped(), 1u);
  EXPECT_TRUE(law.tick(0.029, 0.002).by_law);
  EXPECT_FALSE(law.tick(0.031, 0.002).by_law);  // between a column of either
}

// Known worse than to 10 % it is not begun with; where it is felt it goes on to twice that.
TEST(LawRenderer, ALawThatIsFeltGoesOnWhereItIsKnownWorse) {
  const auto felt_by_law = [](float error_share, double from_x_m) {
    NearLaw law = law_of(0);
    for (std::size_t i = 16; i < law.count; ++i) law.columns[i].error_share = error_share;  // from 32 mm on
    Rendering touch;
    touch.renderer.take_law(law);
    touch.tick(from_x_m, 0.002);
    return touch.tick(0.04, 0.002).by_law;
  };
  EXPECT_TRUE(felt_by_law(0.15F, 0.02));
  EXPECT_FALSE(felt_by_law(0.15F, 0.04));
  EXPECT_FALSE(felt_by_law(0.4F, 0.02));
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

// A service that was restarted may count from one again.
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

TEST(LawRenderer, ALawThatIsHardlyKnownOrPullsIsLeftToAnswers) {
  const auto felt_by_law = [](auto change) {
    NearLaw law = law_of(1);
    for (std::size_t i = 0; i < law.count; ++i) change(law.columns[i]);
    Rendering touch;
    touch.renderer.take_law(law);
    return touch.tick(0.031, 0.002).by_law;
  };
  EXPECT_TRUE(felt_by_law([](LawColumn&) {}));
  EXPECT_FALSE(felt_by_law([](LawColumn& c) { c.error_share = 0.2F; }));
  EXPECT_FALSE(felt_by_law([](LawColumn& c) { c.error_n = 1e30F; }));
  EXPECT_FALSE(felt_by_law([](LawColumn& c) { c.samples[2].log_energy = c.samples[1].log_energy - 1; }));
}

TEST(LawRenderer, AnotherStreamBeginsAnew) {
  Rendering law;
  law.renderer.take_law(law_of(3, 40));
  law.answer(0.03, 0.001, 3, 41);
  EXPECT_FALSE(law.tick(0.03, 0.001).by_law);
  law.renderer.take_law({});
  law.renderer.take_law(law_of(3, 1));
  EXPECT_TRUE(law.tick(0.03, 0.001).by_law);
  // One that was found wrong was the other service's.
  for (int k = 0; k < 4; ++k) law.answer(0.03, 0.002, 20, 1);
  EXPECT_FALSE(law.tick(0.03, 0.002).by_law);
  law.renderer.take_law({});
  law.renderer.take_law(law_of(3, 1));
  EXPECT_TRUE(law.tick(0.03, 0.002).by_law);
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
  const auto felt = [&](double z, double d) {
    return renderer.render({{0.03, d, z}, Vector3::Zero()}, 1, std::numeric_limits<double>::infinity());
  };
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

// Of a solid answers are corrected beside, and what comes first of a law is a guess.
TEST(LawRenderer, IsNotDroppedForAnswersThatSayTheyAreOffNorAsAGuess) {
  for (const double states : {0.05, 0.0}) {
    for (const bool corrected : {true, false}) {
      Rendering law;
      NearLaw near = law_of(3);
      for (LawColumn& column : near.columns) column.corrected = corrected;
      law.answer(0.02, 0.002, 3);
      law.renderer.take_law(near);
      law.tick(0.02, 0.002);
      for (int k = 0; k < 10; ++k) {
        ForceSample sample = answer_at(0.01 + 0.002 * k, 0.003, 3, 10 + std::uint64_t(k), law.time_s);
        sample.force_n *= 1.04;
        sample.relative_error = states;
        law.renderer.update(sample, at(0.02, 0.002), law.time_s);
      }
      EXPECT_EQ(law.renderer.dropped() > 0, states == 0 && corrected) << states << " " << corrected;
    }
  }
}

}  // namespace
}  // namespace teletact::client
