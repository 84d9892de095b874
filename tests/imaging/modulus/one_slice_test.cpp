// What one slice tells of the planes beside it (T3.9), and the iteration that uses it.
#include "service/imaging/modulus/one_slice.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "service/imaging/modulus/fixed_point.h"
#include "service/imaging/modulus/total_variation.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double kRadiusM = 5e-3;

// 60 x 30 mm whose planes count from 0.5 mm on.
class Slice : public ProbedTissue {
 public:
  Slice() { cells_ = {60, 30, 0.5e-3, 1e-3, 1e-3}; }
  Response push(const VectorXd&, double, const Planes&) override { return {}; }
  double nearest_plane_m() const override { return 0.5e-3; }
  VectorXd field(const auto& of) const {
    VectorXd out(static_cast<Index>(cells_.size()));
    for (std::size_t c = 0; c < cells_.size(); ++c)
      out[static_cast<Index>(c)] = of(cells_.x_m(c) - 0.03, cells_.y_m(c) - 0.015);
    return out;
  }
};

TEST(OneSlice, ALumpHasTheVolumeOfABall) {
  const Slice slice;
  const VectorXd disc = slice.field([](double x, double y) { return std::hypot(x, y) < kRadiusM ? 1.0 : 0; });
  const auto planes = planes_beyond({}, disc, slice);
  ASSERT_GE(planes.size(), 8U);
  double volume = 0, last_m = 0, last = disc.sum();
  for (const auto& plane : planes) {
    if (plane.offset_m < 0) continue;
    volume += (plane.offset_m - last_m) * (plane.log_modulus.sum() + last) * 1e-6;  // both sides
    last_m = plane.offset_m, last = plane.log_modulus.sum();
    if (plane.offset_m > kRadiusM) {
      EXPECT_EQ(last, 0) << plane.offset_m;
    }
  }
  const double ball = 4.0 / 3 * std::numbers::pi * std::pow(kRadiusM, 3);
  std::printf("a lump has %.3f of a ball's volume\n", volume / ball);
  EXPECT_NEAR(volume / ball, 1, 0.1);
  for (std::size_t k = 0; k < planes.size(); ++k) {
    EXPECT_EQ(planes[k].offset_m, -planes[planes.size() - 1 - k].offset_m);
    if (k > 0) {
      EXPECT_GT(planes[k].offset_m, planes[k - 1].offset_m);
    }
  }
}

TEST(OneSlice, TheOutermostSliceTellsWhatLiesBeyond) {
  const Slice slice;
  const VectorXd disc = slice.field([](double x, double y) { return std::hypot(x, y) < kRadiusM ? 1.0 : 0; }),
                 none = VectorXd::Zero(disc.size());
  const auto planes = planes_beyond({{2e-3, disc}, {6e-3, 2 * disc}}, none, slice);
  for (const auto& plane : planes) {
    const double most = plane.log_modulus.maxCoeff();
    if (plane.offset_m < 0) {
      EXPECT_EQ(most, 0) << plane.offset_m;
    }
    if (plane.offset_m > 6e-3 && plane.offset_m < 8e-3) {
      EXPECT_EQ(most, 2) << plane.offset_m;
    }
    if (plane.offset_m > 6e-3 + kRadiusM) {
      EXPECT_EQ(most, 0) << plane.offset_m;
    }
  }
  EXPECT_TRUE(std::ranges::is_sorted(planes, {}, &ProbedTissue::ImagePlane::offset_m));
}

// ln E of one cell in this slice, in another, and what is taken for the other's.
TEST(OneSlice, ALumpThatBothShowIsAsStiffAsThisOneSays) {
  struct Case {
    double own, other, taken;
  };
  for (const Case& c : {Case{0.8, 1, 0.8},
                        {1, 0.8, 1},
                        {1, 0.25, 0},
                        {0.25, 1, 1},
                        {0, 1, 1},
                        {0.1, 0.4, 0.1},
                        {-0.1, 0.2, -0.1},
                        {-1, 0.5, 0.5},
                        {-0.8, -1, -0.8},
                        {1, 0, 0}}) {
    const VectorXd own = VectorXd::Constant(1, c.own), other = VectorXd::Constant(1, c.other);
    const auto planes = with_shared_lumps({{5e-3, other}}, own);
    EXPECT_NEAR(planes[0].log_modulus[0], c.taken, 1e-12) << c.own << ", " << c.other;
  }
}

TEST(OneSlice, BetweenSlicesALumpEndsAsABallOrGoesOn) {
  const Slice slice;
  const VectorXd disc = slice.field([](double x, double y) { return std::hypot(x, y) < kRadiusM ? 1.0 : 0; }),
                 none = VectorXd::Zero(disc.size());
  const auto most_at = [&](const VectorXd& next, double z_m) {
    double most = NAN, nearest_m = HUGE_VAL;
    for (const auto& plane : planes_between({{-6e-3, next}, {6e-3, next}}, disc, slice))
      if (const double away_m = std::abs(plane.offset_m - z_m); away_m < nearest_m)
        nearest_m = away_m, most = plane.log_modulus.maxCoeff();
    return most;
  };
  for (const double z_m : {-1.2e-3, 1.2e-3}) EXPECT_EQ(most_at(none, z_m), 1) << z_m;
  for (const double z_m : {-4.5e-3, 4.5e-3, 6e-3}) {
    EXPECT_EQ(most_at(none, z_m), 0) << z_m;
    EXPECT_EQ(most_at(disc, z_m), 1) << z_m;
  }
}

TEST(OneSlice, ALayerAndAStepGoOn) {
  const Slice slice;
  const VectorXd field =
      slice.field([](double x, double y) { return (y > 0 ? 0.7 : 0) + (x > 0 ? 0.4 : 0); });
  for (const auto& plane : planes_beyond({}, field, slice))
    EXPECT_LE((plane.log_modulus - field).cwiseAbs().maxCoeff(), 1e-12) << plane.offset_m;
}

// x <- b + A x, of which plain steps leave 0.95 each time.
TEST(FixedPoint, ReachesInTenStepsWhatPlainOnesDoNot) {
  constexpr Index kSize = 40;
  VectorXd rate(kSize);
  for (Index n = 0; n < kSize; ++n) rate[n] = n < 3 ? 0.95 - 0.1 * static_cast<double>(n) : 0.2;
  const VectorXd load = VectorXd::Ones(kSize), truth = load.array() / (1 - rate.array());
  FixedPoint hastened;
  VectorXd x = VectorXd::Zero(kSize), plain = x;
  for (int step = 0; step < 10; ++step) {
    x = hastened.next(x, load + rate.cwiseProduct(x));
    plain = load + rate.cwiseProduct(plain);
  }
  EXPECT_LE((x - truth).norm(), 0.02 * (plain - truth).norm());
  EXPECT_NEAR((hastened.next(truth, truth) - truth).norm(), 0, 1e-6) << "it stays";
}

// Of an edge that is steeper than `edge_per_m` a part of the cost stays; what is flat costs as before.
TEST(TotalVariation, SteepEdgesCostLess) {
  TissueGrid grid;
  for (int i = 0; i <= 20; ++i) grid.x_m.push_back(1e-3 * i), grid.y_m.push_back(1e-3 * i);
  const TotalVariation variation(grid);
  const auto cost = [&](double jump, double edge_per_m) {
    VectorXd v = VectorXd::Zero(400);
    for (Index n = 0; n < 400; ++n) v[n] = n % 20 < 10 ? 0 : jump;
    return v.dot(variation.lagged(v, edge_per_m) * v);
  };
  EXPECT_NEAR(cost(1, 100) / cost(1, HUGE_VAL), 1 / 11.0, 0.005);
  EXPECT_GE(cost(0.005, 100) / cost(0.005, HUGE_VAL), 0.6);
}

}  // namespace
}  // namespace teletact::service
