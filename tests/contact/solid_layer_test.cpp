// The surface of solid tissue as one finger touches it: which model answers, and what that takes.
#include "service/contact/solid_layer.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "service/base/choices.h"
#include "service/contact/solid_nodes.h"
#include "service/contact/solid_touch_model.h"
#include "tests/solver/block_stencil.h"
#include "tests/tissue/solid/solids.h"

namespace teletact::service {
namespace {

const Fingertip kTip;
const TouchPose kOver{{0.032, 0.002, 0.032}};

// A lump 3 mm below the surface. A first row of top_m is softer than what it lies on.
SolidBlock block_of(double contrast, double deviation = 0, double top_m = 0.002) {
  SolidBlock block;
  SolidGrid grid{32, 32, 0.002, 0.002, {}};
  grid.y_m.push_back(0);
  for (std::size_t j = 1; j <= 20; ++j) grid.y_m.push_back(top_m + double(j - 1) * 0.002);
  block.tissue = solid(grid, 0.49, [=](double x, double y, double z) {
    return (top_m < 0.002 && y < top_m ? 0.7e4 : 1e4) *
           (std::hypot(x - 0.032, y - 0.007, z - 0.032) < 0.004 ? contrast : 1);
  });
  block.region = {0, 0.064, RangeZ{0, 0.064}};
  block.log_deviation = deviation;
  return block;
}

SolidTouchModel model(double contrast, double deviation = 0, double top_m = 0.002) {
  return {block_of(contrast, deviation, top_m), MemoryAccount{}};
}

TouchWay way(std::optional<Tolerance> tolerance = {}, SolvePath path = SolvePath::kAuto) {
  TouchWay out;
  out.device = test_device();
  out.path = path, out.tolerance = tolerance;
  return out;
}

ContactAnswer touch(TouchedLayer& layer, const TouchPose& pose = kOver) {
  layer.answer(kTip, pose);
  if (const auto job = layer.wanted(kTip, pose, 0))
    job->work(TouchedLayer::Clock::now() + std::chrono::seconds(10));
  return layer.answer(kTip, pose);
}

TEST(SolidLayer, TakesSharesWhereTheyAreGoodEnough) {
  const SolidTouchModel lump = model(4);
  const auto path_at = [&](const Tolerance& tolerance) {
    return touch(*lump.layer({}, way(tolerance), {})).path;
  };
  EXPECT_EQ(path_at({0.5, 0}), SolvePath::kShares);
  EXPECT_EQ(path_at({0.12, 0}), SolvePath::kShares);
  EXPECT_EQ(path_at({0.0005, 0}), SolvePath::kGradients) << "by the nodes";
  EXPECT_EQ(path_at({0.0005, 1}), SolvePath::kShares) << "a newton is allowed";
}

TEST(SolidLayer, WhereTheModulusIsBadlyKnownLessWillDo) {
  EXPECT_EQ(touch(*model(3, 0.2).layer({}, way(), {})).path, SolvePath::kShares);
  EXPECT_EQ(touch(*model(3, 0.0).layer({}, way(), {})).path, SolvePath::kGradients);
  EXPECT_EQ(touch(*model(3, 0.2).layer({}, way(Tolerance{}), {})).path, SolvePath::kGradients)
      << "it was asked";
}

TEST(SolidLayer, NoModulusIsSoBadlyKnownThatAnythingWillDo) {
  EXPECT_EQ(usual_tolerance(0), Tolerance{});
  EXPECT_EQ(usual_tolerance(0.1).relative, 0.05);
  EXPECT_EQ(usual_tolerance(10).relative, 0.1);
}

// An answer that was asked for with a tolerance is never one that the tolerance then does not allow, if
// another is allowed.
TEST(SolidLayer, WhatItTakesIsAllowed) {
  const SolidTouchModel lump = model(4);
  for (double share = 0.02; share < 0.3; share *= 1.15)
    for (const double d : {0.0005, 0.002, 0.004}) {
      const Tolerance tolerance{share, 0};
      const ContactAnswer answer = touch(*lump.layer({}, way(tolerance), {}), {{0.032, d, 0.032}});
      const ContactAnswer nodes =
          touch(*lump.layer({}, way({}, SolvePath::kGradients), {}), {{0.032, d, 0.032}});
      if (tolerance.allows(nodes.budget, -nodes.force_n[1])) {
        EXPECT_TRUE(tolerance.allows(answer.budget, -answer.force_n[1])) << share << ", " << d;
      }
    }
}

TEST(SolidLayer, AnswersAreCloseToEachOtherWhateverTheModel) {
  const SolidTouchModel lump = model(4);
  const auto layer = lump.layer({}, way(Tolerance{0.12, 0}), {}),
             nodes = lump.layer({}, way({}, SolvePath::kGradients), {});
  const ContactAnswer one = touch(*layer), other = touch(*nodes);
  ASSERT_EQ(one.path, SolvePath::kShares);
  EXPECT_NEAR(one.force_n[1] / other.force_n[1], 1, one.budget.of_model());
  EXPECT_TRUE(one.pressure.empty());
  EXPECT_EQ(layer->answer(kTip, {{0.032, 0.0001, 0.032}}).remark, "") << "no mesh";
  EXPECT_NE(nodes->answer(kTip, {{0.032, 0.0001, 0.032}}).remark, "");
}

TEST(SolidLayer, ANameOverrules) {
  const SolidTouchModel lump = model(30);
  EXPECT_EQ(touch(*lump.layer({}, way(Tolerance{1e-4, 0}, SolvePath::kShares), {})).path, SolvePath::kShares);
  EXPECT_EQ(touch(*lump.layer({}, way(Tolerance{1, 1}, SolvePath::kGradients), {})).path,
            SolvePath::kGradients);
  EXPECT_THROW(lump.layer(lump.layers()[2], way({}, SolvePath::kShares), {}), std::invalid_argument);
}

TEST(SolidLayer, PressuresAreTheNodes) {
  const SolidTouchModel lump = model(1);
  TouchWay wants = way();
  wants.pressure = true;
  const ContactAnswer answer = touch(*lump.layer({}, wants, {}));
  EXPECT_EQ(answer.path, SolvePath::kGradients);
  EXPECT_FALSE(answer.pressure.empty());
}

// Nobody waits for what is learned: the nodes answer until then.
TEST(SolidLayer, IsAnsweredByTheNodesUntilItHasLearned) {
  const SolidTouchModel lump = model(1);
  lump.layer({}, way({}, SolvePath::kGradients), {});  // its surface is ready
  std::vector<std::function<void()>> jobs;
  const TouchWork later = [&](const std::string&, std::function<void()> job) {
    jobs.push_back(std::move(job));
  };
  EXPECT_NE(lump.plan().find("at the first touch"), std::string::npos);
  const auto layer = lump.layer({}, way(), later);
  ASSERT_TRUE(layer);
  EXPECT_EQ(touch(*layer).path, SolvePath::kGradients);
  EXPECT_EQ(lump.layer({}, way({}, SolvePath::kShares), later), nullptr) << "by name it waits";
  ASSERT_EQ(jobs.size(), 1u) << "asked for once";
  jobs.front()();
  EXPECT_EQ(touch(*layer).path, SolvePath::kShares);
  EXPECT_NE(lump.layer({}, way({}, SolvePath::kShares), later), nullptr);
  EXPECT_NE(lump.plan().find("answered by log-weighted shares: at 2 mm"), std::string::npos) << lump.plan();
}

// A new modulus in the place of one that shares answer: that answers on until they know the new one.
TEST(SolidLayer, IsNotLeftForTheNodesBetweenVersions) {
  const SolidTouchModel before = model(1);
  before.layer({}, way(), {});
  const SolidTouchModel next(before.made_of().solid->block, MemoryAccount{}, before.made_of().solid);
  std::vector<std::function<void()>> jobs;
  const TouchWork later = [&](const std::string&, std::function<void()> job) {
    jobs.push_back(std::move(job));
  };
  EXPECT_EQ(next.layer({}, way(), later), nullptr);
  ASSERT_EQ(jobs.size(), 1u);
  EXPECT_NE(next.layer({}, way({}, SolvePath::kGradients), later), nullptr) << "nodes wait for nothing";
  jobs.front()();
  const auto layer = next.layer({}, way(), later);
  ASSERT_TRUE(layer);
  EXPECT_EQ(touch(*layer).path, SolvePath::kShares);
}

TEST(SolidLayer, ThePlanSaysWhereTheNodesAnswer) {
  const SolidTouchModel hard = model(30);
  hard.layer({}, way(), {});
  EXPECT_NE(hard.plan().find("shares where they do, else by the nodes"), std::string::npos) << hard.plan();
}

// Shares know a contact up to some 16 times the first row's thickness.
TEST(SolidLayer, ThePlanOfAThinFirstRowIsOfAShallowerTouch) {
  const SolidTouchModel thin = model(1, 0, 0.0002);
  thin.layer({}, way(), {});
  EXPECT_NE(thin.plan().find("answered by log-weighted shares"), std::string::npos) << thin.plan();
  EXPECT_EQ(thin.plan().find("at 2 mm"), std::string::npos) << thin.plan();
}

// Nodes of a hard lump at the surface: a deep tip has no contact there.
TEST(SolidLayer, WhereTheNodesHaveNoContactItSaysWhatIsLeft) {
  SolidBlock block = model(1).made_of().solid->block;
  SolidTissue& tissue = block.tissue;
  tissue = solid(tissue.grid, 0.49, [](double x, double y, double z) {
    return std::hypot(x - 0.032, y - 0.002, z - 0.032) < 0.006 ? 3e5 : 1e4;
  });
  const SolidTouchModel hard(std::move(block), MemoryAccount{});
  const TouchPose deep{{0.032, 0.004, 0.032}};
  EXPECT_THROW(touch(*hard.layer({}, way({}, SolvePath::kGradients), {}), deep), std::domain_error);
  const ContactAnswer answer = touch(*hard.layer({}, way(), {}), deep);
  EXPECT_EQ(answer.path, SolvePath::kShares);
  EXPECT_LT(answer.force_n[1], -0.5);
  EXPECT_FALSE(answer.solve.converged);
  EXPECT_GT(answer.solve.relative_error, 0.5);
  EXPECT_STREQ(answer.solve.reason, kNoContactReason);
  // What a shallower touch leaves is a guess of contact there, which the correction takes away.
  const auto layer = hard.layer({}, way(), {});
  for (const double deep_m : {0.001, 0.002, 0.003, 0.004}) {
    const TouchPose pose{{0.032, deep_m, 0.032}};
    if (const auto job = layer->wanted(kTip, pose, 0)) {
      EXPECT_NO_THROW(job->work(TouchedLayer::Clock::now() + choices::kLongestSolve)) << deep_m;
    }
    EXPECT_LT(layer->answer(kTip, pose).force_n[1], 0) << deep_m;
  }
}

// GIVEN a lump that shares are off by more at than is allowed, WHEN it is touched before the nodes are
// corrected, THEN shares answer, and not as a solution that converged: how far they are off is what it is
// trusted by.
TEST(SolidLayer, SharesInThePlaceOfLateNodesSaySo) {
  const SolidTouchModel lump = model(8);
  const auto layer = lump.layer({}, way(), {});
  const ContactAnswer late = layer->answer(kTip, kOver);
  ASSERT_EQ(late.path, SolvePath::kShares);
  EXPECT_FALSE(late.solve.converged);
  EXPECT_TRUE(late.solve.improving);
  EXPECT_STREQ(late.solve.reason, kLateReason);
  EXPECT_GT(late.solve.relative_error, choices::kTrustedMeanwhile);
  EXPECT_NEAR(late.solve.relative_error, ForceBudget::kOf95 * late.budget.relative(ErrorTerm::kModel), 1e-9);
  const ContactAnswer nodes = touch(*layer);
  EXPECT_EQ(nodes.path, SolvePath::kGradients);
  EXPECT_TRUE(nodes.solve.converged);
}

// GIVEN a lump that the nodes are not corrected at, THEN what they want says how far off they are and that a
// finger that is put down has no answer before; where shares stand in it has one, and nothing is wanted of a
// finger that rests once they are corrected.
TEST(SolidLayer, WhatItWantsSaysHowFarOffItIsAndWhoWaits) {
  const SolidTouchModel lump = model(8);
  const auto nodes = lump.layer({}, way({}, SolvePath::kGradients), {}), planned = lump.layer({}, way(), {});
  const ContactAnswer guess = nodes->answer(kTip, kOver);
  EXPECT_TRUE(guess.solve.improving);
  const auto job = nodes->wanted(kTip, kOver, 0), meanwhile = planned->wanted(kTip, kOver, 0);
  ASSERT_TRUE(job && meanwhile);
  EXPECT_DOUBLE_EQ(job->error, guess.solve.relative_error - guess.solve.of_model);
  EXPECT_EQ(job->wait, JobWait::kFirst);
  EXPECT_EQ(meanwhile->wait, JobWait::kAwaited);
  EXPECT_LE(meanwhile->error, job->error);
  EXPECT_FALSE(nodes->wanted(kTip, {{0.032, -0.001, 0.032}}, 0)) << "above";
  EXPECT_TRUE(job->work(TouchedLayer::Clock::now() + std::chrono::seconds(10)));
  EXPECT_TRUE(nodes->answer(kTip, kOver).solve.converged);
  EXPECT_FALSE(nodes->wanted(kTip, kOver, 0));
  TouchPose moving = kOver;
  moving.velocity_m_s = {0.05, 0, 0};
  const auto ahead = nodes->wanted(kTip, moving, 0);
  ASSERT_TRUE(ahead) << "for where it will be";
  EXPECT_EQ(ahead->error, 0);
  EXPECT_EQ(ahead->wait, JobWait::kBeside);
}

TEST(SolidNodes, BesideAnEstimateAMovingFingerWaitsWithLittle) {
  TouchPose moving = kOver;
  moving.velocity_m_s = {0.01, 0, 0};
  const auto corrections = [](SolidNodes& nodes, const TouchPose& pose) {
    const std::uint64_t done = nodes.corrector.done();
    nodes.corrector.ask(kTip, pose);
    nodes.corrector.wait_for_more_than(done, Corrector::Clock::now() + std::chrono::seconds(10));
    return nodes.contact.corrections();
  };
  const auto device = test_device();
  SolidNodes little(block_of(1.2), device, {}), much(block_of(8), device, {});
  EXPECT_LT(little.contact.answer(kTip, kOver.position_m).solve.relative_error, choices::kTrustedMeanwhile);
  EXPECT_GT(much.contact.answer(kTip, kOver.position_m).solve.relative_error, choices::kTrustedMeanwhile);
  auto imaging = device->imaging();
  EXPECT_EQ(corrections(little, moving), 0);
  EXPECT_EQ(corrections(much, moving), 1);
  imaging.reset();
  EXPECT_EQ(corrections(little, moving), 1);
  SolidNodes resting(block_of(1.2), device, {});
  imaging = device->imaging();
  EXPECT_EQ(corrections(resting, kOver), 1);
}

TEST(SolidLayer, WhatALawIsSampledByIsPlannedToo) {
  const SolidTouchModel lump = model(4);
  const auto for_law = [&](const Tolerance& tolerance) {
    TouchWay of_law = way(tolerance);
    of_law.law = true;
    return lump.layer({}, of_law, {});
  };
  const auto apart = for_law({0.12, 0}), fine = for_law({0.0005, 0});
  EXPECT_EQ(touch(*apart).path, SolvePath::kShares);
  EXPECT_EQ(touch(*apart, {{0.01, 0.002, 0.01}}).path, SolvePath::kShares);
  EXPECT_EQ(touch(*fine).path, SolvePath::kGradients);
}

TEST(SolidLayer, BesideTheBlockItIsNotTouched) {
  EXPECT_THROW(model(1).layer({}, way(), {})->answer(kTip, {{-0.001, 0.002, 0.03}}), std::out_of_range);
}

}  // namespace
}  // namespace teletact::service
