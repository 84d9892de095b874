// What slices of one solid tell each other of the tissue that they share.
#include "service/imaging/modulus/told_tissue.h"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include <cmath>
#include <cstdio>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "service/base/squared.h"
#include "service/imaging/modulus/skin.h"
#include "tests/imaging/imaging_device.h"
#include "tests/imaging/modulus/pressed.h"

namespace teletact::service {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kFaceM = 0.01, kDepthM = 0.04;

// Fitted with [tilt, grading, elevation, depth]; `misfit` 0 is the likeliest.
CandidateTissue tissue(double beside_m, double log_prior, double misfit) {
  CandidateTissue m;
  m.face = {.width_m = 0.06, .elevation_m = kFaceM, .depth_m = kDepthM, .image_depth_m = kDepthM};
  m.face.beside_m = beside_m;
  m.place_m = std::isfinite(beside_m) ? beside_m : 0;
  m.log_prior = log_prior;
  m.fit.at = VectorXd::Zero(4);
  m.fit.covariance = VectorXd::Constant(4, squared(0.03)).asDiagonal();
  m.fit.misfit = misfit;
  return m;
}

std::vector<WeighedTissues> of_slice(std::vector<CandidateTissue> models) {
  TissueWindow w{{},
                 0,
                 {false, std::log(kFaceM), 0.6, std::log(3e-3), std::log(0.04)},
                 {false, std::log(kDepthM), 0.4, std::log(kDepthM), std::log(0.12)}};
  w.face = models[0].face;
  return {{w, std::move(models)}};
}

std::vector<WeighedTissues> two_kinds() {
  return of_slice({tissue(HUGE_VAL, std::log(0.5), 1.5), tissue(0.028, std::log(0.05), 0)});
}

double weight_of_ending(std::vector<WeighedTissues> starts, const std::vector<ToldBeside>& beside) {
  add_odds(beside, starts);
  weigh_together(starts);
  return starts[0].models[1].weight;
}

TEST(ToldTissue, SlicesThatAFaceApartMultiplyTheirOddsAndNearerOnesInPart) {
  const auto told = told_by(two_kinds());
  ASSERT_EQ(told.size(), 2U);
  EXPECT_EQ(told[0].log_likelihood, -1.5);
  EXPECT_EQ(told[1].log_likelihood, 0);
  // Odds of what ends: 0.1 e^1.5 by each.
  const auto weight = [](double slices) {
    const double odds = 0.1 * std::exp(1.5 * (1 + slices));
    return odds / (1 + odds);
  };
  EXPECT_NEAR(weight_of_ending(two_kinds(), {}), weight(0), 1e-12);
  EXPECT_NEAR(weight_of_ending(two_kinds(), {{kFaceM, told}}), weight(1), 1e-12);
  EXPECT_NEAR(weight_of_ending(two_kinds(), {{-kFaceM, told}, {kFaceM, told}}), weight(2), 1e-12);
  EXPECT_NEAR(weight_of_ending(two_kinds(), {{kFaceM / 2, told}, {kFaceM, told}}), weight(1), 1e-12);
  std::vector<ToldBeside> many;
  for (int n = 1; n <= 40; ++n) many.push_back({n * kFaceM, told});
  EXPECT_NEAR(weight_of_ending(two_kinds(), many), weight(4), 1e-12) << "what the model leaves out is shared";
}

TEST(ToldTissue, ATissueThatASliceDidNotWeighIsUnlikelyNotExcluded) {
  const auto told = told_by(of_slice({tissue(HUGE_VAL, 0, 0), tissue(0.004, 0, 0)}));
  const double before = weight_of_ending(two_kinds(), {}), odds = before / (1 - before) * std::exp(-5.0);
  EXPECT_NEAR(weight_of_ending(two_kinds(), {{kFaceM, told}}), odds / (1 + odds), 1e-12);
  // Where the face was tilted, none that ends was weighed.
  const auto tilted = told_by(of_slice({tissue(HUGE_VAL, 0, 0)}));
  EXPECT_EQ(weight_of_ending(two_kinds(), {{kFaceM, tilted}}), before);
}

// Where it ends as stated is the same in each slice, whose depths differ.
TEST(ToldTissue, AStatedPlaceIsTheSameInEachSlice) {
  auto here = two_kinds(), there = two_kinds();
  here[0].window.beside_m = there[0].window.beside_m = 0.028;
  there[0].window.face.depth_m = 1.1 * kDepthM;
  EXPECT_GT(weight_of_ending(here, {{kFaceM, told_by(there)}}), weight_of_ending(here, {}));
}

TEST(ToldTissue, ANumberIsThatOfAllMeasurementsWithWhatIsKnownBeforehandOnce) {
  // GIVEN a depth that one slice alone finds at ln +0.05, another at 0, each to 0.03 with what was known
  // (0.4)
  auto here = of_slice({tissue(HUGE_VAL, 0, 0)}), there = here;
  there[0].models[0].fit.at[kDepth] = 0.05;
  const auto told = told_by(there);
  const double beforehand = 1 / squared(0.4), both = 1 / squared(0.03), own = both - beforehand;
  EXPECT_NEAR(told[0].information(1, 1), own, 1e-9 * own);
  EXPECT_NEAR(told[0].load[1] / own, std::log(kDepthM) + 0.05 * both / own, 1e-9);
  // THEN it has the mean and the variance of both, and of how depths vary from slice to slice
  weigh_together(here);
  ASSERT_EQ(sharpen({{kFaceM, told}}, here), Heeded::kAll);
  const double from_there = 1 / (1 / own + squared(0.03)), all = both + from_there;
  EXPECT_NEAR(here[0].models[0].fit.covariance(kDepth, kDepth), 1 / all, 1e-9 / all);
  EXPECT_NEAR(here[0].models[0].fit.at[kDepth], 0.05 * both / own * from_there / all, 1e-9);
  // AND what correlates with it follows.
  auto tied = of_slice({tissue(HUGE_VAL, 0, 0)});
  tied[0].models[0].fit.covariance(kTilt, kDepth) = tied[0].models[0].fit.covariance(kDepth, kTilt) =
      squared(0.03) / 2;
  weigh_together(tied);
  ASSERT_EQ(sharpen({{kFaceM, told}}, tied), Heeded::kAll);
  EXPECT_NEAR(tied[0].models[0].fit.at[kTilt], tied[0].models[0].fit.at[kDepth] / 2, 1e-12);
  EXPECT_LT(tied[0].models[0].fit.covariance(kTilt, kTilt), squared(0.03));
}

TEST(ToldTissue, SkinIsToldWhereItWasFitted) {
  auto here = of_slice({tissue(HUGE_VAL, 0, 0)});
  CandidateTissue& m = here[0].models[0];
  m.with_skin = m.fit;
  m.with_skin->at = VectorXd::Zero(4 + Eigen::Index{kSkinChanges});
  m.with_skin->covariance = MatrixXd::Identity(m.with_skin->at.size(), m.with_skin->at.size()) * squared(0.2);
  const auto told = told_by(here);
  ASSERT_EQ(told[0].load.size(), 2 + Eigen::Index{kSkinChanges});
  weigh_together(here);
  ASSERT_EQ(sharpen({{-kFaceM, told}, {kFaceM, told}}, here), Heeded::kAll);
  const CandidateTissue& sharper = here[0].models[0];
  // Two more, each to 0.2 without what is known beforehand (0.49), and 0.15 from slice to slice.
  const double other = 1 / (1 / squared(0.2) - 1 / squared(0.49)) + squared(0.15);
  EXPECT_NEAR(1 / sharper.with_skin->covariance(4, 4), 1 / squared(0.2) + 2 / other, 1e-9);
  EXPECT_EQ(sharper.fit.covariance(kDepth, kDepth), squared(0.03)) << "the fit without skin is not published";
}

// A strain that shows the sum of two changes alone: four slices know no more of either than the sum says.
TEST(ToldTissue, WhatIsKnownBeforehandIsCountedOnceThoughNumbersCorrelate) {
  constexpr double kSum = 0.003;
  const double known = 1 / squared(SkinPrior{}.deviation[0]), seen = 1 / squared(1e-3);
  auto there = of_slice({tissue(HUGE_VAL, 0, 0)});
  const auto with_skin = [&](std::vector<WeighedTissues>& slice, double information) {
    CandidateTissue& m = slice[0].models[0];
    m.with_skin = m.fit;
    const Eigen::Index count = 4 + Eigen::Index{kSkinChanges};
    MatrixXd all = MatrixXd::Identity(count, count) * known;
    all.topLeftCorner(4, 4).diagonal().setConstant(1 / squared(0.03));
    all.block(4, 4, 2, 2).array() += information;
    m.with_skin->covariance = all.inverse();
    VectorXd load = VectorXd::Zero(count);
    load.segment(4, 2).setConstant(information * kSum);
    m.with_skin->at = m.with_skin->covariance * load;
  };
  with_skin(there, seen);
  auto here = there;
  with_skin(here, 0);
  std::vector<ToldBeside> four;
  for (const double at : {-2.0, -1.0, 1.0, 2.0}) four.push_back({at * kFaceM, told_by(there)});
  weigh_together(here);
  ASSERT_EQ(sharpen(four, here), Heeded::kAll);
  const RobustFit& fit = *here[0].models[0].with_skin;
  EXPECT_LE(fit.at[4] + fit.at[5], kSum);
  EXPECT_NEAR(fit.at[4], fit.at[5], 1e-9);
  const double apart = fit.covariance(4, 4) + fit.covariance(5, 5) - 2 * fit.covariance(4, 5);
  EXPECT_NEAR(apart, 2 / known, 1e-3) << "of their difference nothing is told";
}

// What is stated counts for less the farther the strain leads from it: so much less is taken off.
TEST(ToldTissue, WhatIsStatedIsTakenOffAsTheFitHeedsIt) {
  auto slice = of_slice({tissue(HUGE_VAL, 0, 0)});
  slice[0].window.depth.stated = true, slice[0].window.depth.deviation = 0.1;
  slice[0].models[0].fit.at[kDepth] = 0.2;
  const double heeded = 1 / squared(0.1) / (1 + squared(0.2 / 0.1) / 2);
  EXPECT_NEAR(told_by(slice)[0].information(1, 1), 1 / squared(0.03) - heeded, 1e-6);
}

TEST(ToldTissue, OddsOfSlicesThatContradictAreNotHeededEither) {
  // GIVEN tissues that end too near for their skin, the one as another slice has it, but for its depth
  const auto two = [] { return of_slice({tissue(0.004, 0, 1), tissue(0.008, 0, 0)}); };
  auto alone = two(), here = two(), there = of_slice({tissue(0.004, 0, 0), tissue(0.008, 0, 4)});
  for (CandidateTissue& m : there[0].models) m.fit.at[kDepth] = 0.3;
  const TissueWeigher weigher(imaging_device()->queue(), {}, std::make_shared<StripCache>());
  weigh_together(alone);
  const TogetherWeighed weighed = weigh_together(weigher, {{kFaceM, told_by(there)}}, here);
  EXPECT_EQ(weighed.heeded, Heeded::kContradicted);
  EXPECT_EQ(weighed.told.size(), 2U);
  for (const std::size_t m : {0U, 1U}) EXPECT_EQ(here[0].models[m].weight, alone[0].models[m].weight);
}

TEST(ToldTissue, WhatContradictsTheLikeliestOrLeadsFarChangesNothing) {
  for (const double deviation : {0.03, 0.2}) {  // 7 of it away; and 1, but farther than a fit is linear
    auto here = of_slice({tissue(HUGE_VAL, 0, 0)});
    here[0].models[0].fit.covariance(kDepth, kDepth) = squared(deviation);
    auto there = here;
    there[0].models[0].fit.at[kDepth] = 0.3;
    weigh_together(here);
    EXPECT_EQ(sharpen({{kFaceM, told_by(there)}}, here), Heeded::kContradicted);
    EXPECT_EQ(here[0].models[0].fit.at[kDepth], 0);
    EXPECT_EQ(here[0].models[0].fit.covariance(kDepth, kDepth), squared(deviation));
  }
}

// One estimate after the other with one method.
struct Slices {
  const std::unique_ptr<ModulusMethod> method = make_solid(imaging_device()->queue(), {});
  ModulusEstimate estimate(const test::Pressed& pressed, const std::vector<ToldBeside>& told,
                           double elevation_m = test::kElevationM) const {
    const TissueExtent tissue{0.1, test::kDepthM, 0.035, 0.49, Plane::kSolid, elevation_m};
    ModulusInput in{pressed.measured, test::kWidthM, tissue, pressed.force};
    in.told = told;
    return method->estimate(in);
  }
};

TEST(ToldTissue, ASliceBeginsWhereOthersFoundTheTissueAndFindsTheSame) {
  for (const auto& [of, is] : {std::pair(test::face(0.015, true), "slides"),
                               std::pair(test::face(0.007), "ends"), std::pair(test::face(), "continues")}) {
    const auto homogeneous = [](double of_all) { return [=](double, double) { return of_all; }; };
    std::vector<test::Pressed> pressed;
    for (const unsigned seed : {1U, 2U, 3U}) pressed.emplace_back(of, homogeneous(1), homogeneous(0), seed);
    const auto third = [&](bool begins) {
      const Slices slices;
      std::vector<ToldBeside> told;
      for (const std::size_t n : {0U, 1U}) {
        told.insert(told.begin(), {0.006, slices.estimate(pressed[n], told).told});
        for (ToldTissue& t : told.front().tissues)
          if (!begins) t.elevation_m = t.depth_m = t.beside_m = 0;
        if (n > 0) told.back().offset_m = 0.012;
      }
      return slices.estimate(pressed[2], told);
    };
    const ModulusEstimate with = third(true), without = third(false);
    std::printf("%s: %d solves, without begins %d\n", is, with.solves, without.solves);
    EXPECT_LT(with.solves, without.solves);
    for (const ModulusEstimate* e : {&with, &without}) {
      EXPECT_NE(e->model.find(is), std::string::npos) << e->model;
      EXPECT_NE(e->model.find("; agrees with other slices"), std::string::npos) << e->model;
      EXPECT_NEAR(test::background(*e, pressed[2].measured) / test::kModulusPa, 1, 0.1) << e->model;
    }
  }
}

TEST(ToldTissue, ASliceThatContradictsOthersIsSearchedAsIfThereWereNone) {
  ProbeFace longer = test::face();
  longer.elevation_m = 0.008;
  const test::Pressed pressed(test::face()), other(longer);
  const Slices slices;
  const std::vector<ToldBeside> told{{0.006, slices.estimate(other, {}, longer.elevation_m).told}};
  ASSERT_FALSE(told[0].tissues.empty());
  const ModulusEstimate alone = slices.estimate(pressed, {}), here = slices.estimate(pressed, told);
  EXPECT_NE(here.model.find("disagrees with other slices"), std::string::npos) << here.model;
  ASSERT_EQ(here.youngs_modulus.size(), alone.youngs_modulus.size());
  for (std::size_t n = 0; n < alone.youngs_modulus.size(); ++n) {
    if (!std::isfinite(alone.youngs_modulus[n])) continue;
    EXPECT_NEAR(here.youngs_modulus[n] / alone.youngs_modulus[n], 1, 1e-3);
  }
}

TEST(ToldTissue, BeginsWithinWhatTheWindowAllows) {
  const auto starts = of_slice({tissue(HUGE_VAL, 0, 0)});
  const TissueWindow& w = starts[0].window;
  ToldTissue told;
  EXPECT_EQ(nearest({{kFaceM, {told}}}, told), nullptr) << "a file of before";
  told.elevation_m = 1e-7, told.depth_m = 5;
  const ProbeFace far = begun_at(told, w, w.face);
  EXPECT_DOUBLE_EQ(far.elevation_m, 3e-3);
  EXPECT_DOUBLE_EQ(far.depth_m, 0.12);
  told.elevation_m = 0.01 / 3, told.depth_m = 0.05 / 0.9;
  const ProbeFace here = begun_at(told, w, w.face);
  EXPECT_EQ(here.elevation_m, 0.01 / 3) << "to the last digit: its answers are kept";
  EXPECT_EQ(here.depth_m, 0.05 / 0.9);
}

// What is told is by the likeliest face, unless that is near the one that was solved; of the reference its
// own.
TEST(ToldTissue, TellsWhereTheNextSliceBegins) {
  auto starts =
      of_slice({tissue(HUGE_VAL, 0, 9), tissue(0.004, 0, 0), tissue(0.008, 0, 0), tissue(0.012, 0, 9)});
  for (CandidateTissue& m : starts[0].models) m.fit.at[kDepth] = 0.1;
  starts[0].models[2].fit.at[kDepth] = 0.03;
  const TissueWeigher weigher(imaging_device()->queue(), {}, std::make_shared<StripCache>());
  const std::vector<ToldTissue> told = weigh_together(weigher, {}, starts).told;
  ASSERT_EQ(told.size(), 4U);
  EXPECT_EQ(told[0].depth_m, kDepthM) << "the reference";
  EXPECT_NEAR(told[1].depth_m, kDepthM * std::exp(0.1), 1e-9);
  EXPECT_EQ(told[2].depth_m, kDepthM) << "near where it was solved";
  EXPECT_EQ(told[3].depth_m, kDepthM) << "does not count";
  EXPECT_EQ(told[2].beside_m, 0.008);
}

}  // namespace
}  // namespace teletact::service
