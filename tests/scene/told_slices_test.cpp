// What slices told of the tissue that they share, kept for those that come.
#include "service/scene/told_slices.h"

#include <gtest/gtest.h>

#include "service/scene/scene.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

std::vector<ToldTissue> told(int place) {
  return {{1, 0, place}};
}

ExplicitModulus with_slices(std::vector<double> slices_m) {
  ExplicitModulus e;
  e.slices_m = std::move(slices_m);
  return e;
}

TEST(ToldSlices, AreOfTheSolidsSlicesButForTheOneInQuestion) {
  ToldSlices slices;
  slices.tell(-0.005, told(1)), slices.tell(0, told(2)), slices.tell(0.01, told(3));
  const ExplicitModulus e = with_slices({-0.005, 0, 0.005});
  const auto beside = slices.beside(e, 0);
  ASSERT_EQ(beside.size(), 1U) << "one at 0.01 was never published";
  EXPECT_DOUBLE_EQ(beside[0].offset_m, -0.005);
  EXPECT_EQ(beside[0].tissues[0].place, 1);
  // A newer one takes the older one's place, to a rounding; one that tells nothing does not.
  slices.tell(-0.005 + 1e-9, told(4)), slices.tell(1e-9, {});
  const auto newer = slices.beside(e, 0.005);
  ASSERT_EQ(newer.size(), 2U);
  EXPECT_EQ(newer[0].tissues[0].place, 4);
  EXPECT_EQ(newer[1].tissues[0].place, 2);
}

TEST(ToldSlices, AreBoundedWhereverAPeerPutsThem) {
  ToldSlices slices;
  std::vector<double> places;
  for (int n = 0; n < 400; ++n) places.push_back(1e-4 * n), slices.tell(places.back(), told(n));
  const auto kept = slices.beside(with_slices(places), 1);
  ASSERT_EQ(kept.size(), ToldSlices::kMost);
  EXPECT_EQ(kept.back().tissues[0].place, 399) << "the farthest from the newest go";
}

const Limits kLimits = resolved({}, std::uint64_t{1} << 32, std::uint64_t{1} << 32);

// A solid with two slices, one of which has told.
SceneRecord kept(const ToldTissue& told) {
  ExplicitModulus e;
  e.x_m = {0, 0.02, 0.04}, e.y_m = {0, 0.01, 0.02}, e.z_m = {0, 0.01, 0.02};
  e.youngs_modulus_pa = {1e4, 2e4, 1e4, 2e4, 3e4, 4e4, 3e4, 4e4};
  SceneRecord record;
  record.id = "s", record.geometry = tissue(0.04, 0.02), record.version = 3;
  record.explicit_modulus = e, record.told[0.005] = {told, {0, 1, 30, -2.5}};
  return record;
}

ToldTissue numbers() {
  ToldTissue t{1, 0, -1, -0.25, Eigen::MatrixXd::Identity(2, 2), Eigen::VectorXd::Constant(2, 0.1)};
  t.information << 400, 30, 30, 90;
  return t;
}

SceneRecord read_again(const SceneRecord& record) {
  const EncodedScene files = encoded(record);
  return decoded(
      files.description, [&](const std::string&) { return files.map; }, kLimits);
}

TEST(ToldSlices, AreKeptWithTheirScene) {
  const Scene scene(read_again(kept(numbers())), versions(), kLimits);
  const SceneRecord again = scene.record();
  ASSERT_EQ(again.told.size(), 1U);
  const std::vector<ToldTissue>& tissues = again.told.at(0.005);
  ASSERT_EQ(tissues.size(), 2U);
  EXPECT_EQ(tissues[0].place, -1);
  EXPECT_EQ(tissues[0].log_likelihood, -0.25);
  EXPECT_EQ(tissues[0].information, numbers().information);
  EXPECT_EQ(tissues[0].load, numbers().load);
  EXPECT_EQ(tissues[1].slides, 1);
  EXPECT_EQ(tissues[1].load.size(), 0);
}

TEST(ToldSlices, WhatNoSliceTellsIsNotRead) {
  const auto refused = [](const auto& spoil) {
    ToldTissue t = numbers();
    spoil(t);
    EXPECT_THROW(read_again(kept(t)), std::runtime_error);
  };
  refused([](ToldTissue& t) { t.log_likelihood = 1; });
  refused([](ToldTissue& t) { t.log_likelihood = std::nan(""); });
  refused([](ToldTissue& t) { t.load[1] = HUGE_VAL; });
  refused([](ToldTissue& t) { t.information(1, 1) = -1; });
  refused([](ToldTissue& t) { t.information(0, 1) = 60; });
}

TEST(ToldSlices, AreChargedToTheirScene) {
  const auto budget = std::make_shared<MemoryBudget>(kLimits);
  ToldSlices slices({budget, "a"});
  slices.tell(0, {numbers()});
  const std::uint64_t one = budget->held(Place::kHost);
  EXPECT_GE(one, sizeof(ToldTissue) + 6 * sizeof(double));
  slices.tell(0, {numbers()});
  EXPECT_EQ(budget->held(Place::kHost), one);
  slices.tell(0.01, {numbers()});
  EXPECT_EQ(budget->held(Place::kHost), 2 * one);
}

}  // namespace
}  // namespace teletact::service
