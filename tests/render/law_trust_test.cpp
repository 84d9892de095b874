// Which laws are believed, and which are dropped for the answers that contradict them.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/render/law_rendering.h"

namespace teletact::client {
namespace {

using test::answer_at;
using test::at;
using test::law_of;
using test::Rendering;

TEST(LawRenderer, DropsALawAfterFourContradictions) {
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
TEST(LawRenderer, MovingFingerFindsALawWrong) {
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
TEST(LawRenderer, WrongLawsOfSeveralWindowsStayDropped) {
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

// Of a solid answers are corrected beside, and what comes first of a law is a guess.
TEST(LawRenderer, KeepsGuessesAndIgnoresDoubtfulAnswers) {
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

// A service that was restarted may count from one again.
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

}  // namespace
}  // namespace teletact::client
