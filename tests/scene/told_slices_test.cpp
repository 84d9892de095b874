// What slices told of the tissue that they share, kept for those that come.
#include "service/scene/told_slices.h"

#include <gtest/gtest.h>

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

// What is refused changes nothing.
TEST(ToldSlices, AreChargedToTheirScene) {
  Limits limits = resolved({}, std::uint64_t{1} << 32, std::uint64_t{1} << 32);
  const ToldTissue tissue{1, 0, -1, -0.25, Eigen::MatrixXd::Identity(2, 2), Eigen::VectorXd::Zero(2)};
  constexpr std::uint64_t kOne = sizeof(ToldTissue) + 6 * sizeof(double);
  limits.host_memory_bytes = 5 * kOne / 2, limits.client_memory_share = 1;
  const auto budget = std::make_shared<MemoryBudget>(limits);
  ToldSlices slices({budget, "a"});
  slices.tell(0, {tissue});
  EXPECT_EQ(budget->held(Place::kHost), kOne);
  slices.tell(0, {tissue});
  EXPECT_EQ(budget->held(Place::kHost), kOne);
  slices.tell(0.01, {tissue}), slices.tell(0.02, {tissue});
  EXPECT_EQ(budget->held(Place::kHost), 2 * kOne);
  EXPECT_EQ(slices.beside(with_slices({0, 0.01, 0.02}), 1).size(), 2U);
}

}  // namespace
}  // namespace teletact::service
