// What is stated and uncertain (T3.10): each part against what an estimate changes by, where the statement
// does.
#include "service/imaging/modulus/common_deviation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <vector>

#include "service/imaging/modulus/probed_tissue.h"
#include "service/imaging/tracking/median.h"
#include "tests/imaging/modulus/modulus_phantom.h"

namespace teletact::service {
namespace {

constexpr ModulusKind kQuick = ModulusKind::kReferenceStress;

// ln of the background's modulus over `before`'s.
double moved(const ModulusEstimate& before, const ModulusEstimate& after) {
  return std::log(after.background / before.background);
}

TEST(CommonDeviation, OfTheForceStandsInEveryNodeOnce) {
  Phantom p({});
  const ModulusEstimate without = p.estimate(kQuick);
  p.force->own_deviation = 0.24, p.force->shared_deviation = 0.1;
  const ModulusEstimate with = p.estimate(kQuick);
  EXPECT_NEAR(with.common_deviation, std::hypot(without.common_deviation, 0.24, 0.1), 1e-9);
  for (std::size_t n = 0; n < with.log_deviation.size(); ++n)
    if (std::isfinite(with.log_deviation[n])) {
      ASSERT_NEAR(with.log_deviation[n], std::hypot(without.log_deviation[n], 0.24, 0.1), 1e-5);
    }
  EXPECT_GT(with.correlation_m, without.correlation_m) << "what is common correlates";
  EXPECT_GT(with.median_deviation, 0.26);
  p.force.reset();
  EXPECT_EQ(p.estimate(kQuick).common_deviation, 0) << "a relative modulus has no scale";
}

TEST(CommonDeviation, OfAPlaneIsWhatItsEstimateMovesBy) {
  constexpr double kDepthM = 0.003, kNu = 0.005;
  const auto stated = [](const std::function<void(TissueExtent&)>& state) {
    Phantom p({.contrast = 1.001});
    state(p.tissue);
    return p.estimate(ModulusKind::kDirect);
  };
  const ModulusEstimate before = stated([](auto&) {});
  const double by_depth = moved(before, stated([](auto&t) { t.depth_m += kDepthM; })),
               by_nu = moved(before, stated([](auto&t) { t.poisson_ratio -= kNu; })),
               of_depth = stated([](auto&t) { t.depth_std_m = kDepthM; }).common_deviation,
               of_nu = stated([](auto&t) { t.poisson_std = kNu; }).common_deviation;
  std::printf("depth: moved %.4f, stated %.4f; nu: %.4f, %.4f\n", by_depth, of_depth, by_nu, of_nu);
  EXPECT_NEAR(of_depth, std::abs(by_depth), 0.3 * of_depth);
  EXPECT_NEAR(of_nu, std::abs(by_nu), 0.3 * of_nu);
}

// The same echoes with another speed of sound: depth and displacement are stretched alike.
TEST(CommonDeviation, OfTheSpeedOfSoundIsTheSlopeOfStress) {
  constexpr double kFaster = 1.02;
  Phantom p({.window_m = 0.0}), stretched({.window_m = 0.0});
  stretched.grid.origin_y_m *= kFaster, stretched.grid.dy_m *= kFaster;
  for (double& u : stretched.axial) u *= kFaster;
  const auto strips = std::make_shared<StripCache>();
  const ModulusEstimate as_stated = p.estimate(kQuick);
  ModulusInput in = p.input();
  in.sound_speed_deviation = kFaster - 1;
  const double stated = common_deviation(in, *strips, as_stated),
               by = moved(as_stated, stretched.estimate(kQuick));
  std::printf("speed of sound: moved %.4f, stated %.4f\n", by, stated);
  EXPECT_NEAR(stated, std::abs(by), 0.5 * stated);
}

// Against one more solve of the forward model, which an estimate does not pay for.
TEST(CommonDeviation, OfASolidsPoissonRatioIsWhatAnotherSolveShows) {
  constexpr double kStep = 0.01, kNu = 0.48, kFaceM = 0.030;
  Phantom p({});
  ModulusInput in = p.input();
  StripCache strips;
  ModulusEstimate solid;
  solid.kind = ModulusKind::kSolid, solid.absolute = true;
  for (const auto& [elevation_m, depth_m] : {std::pair{0.005, 0.020}, {0.010, 0.020}, {0.005, 0.030}}) {
    // Of each cell, as of a plane's nodes: the median's cell alone is another in each mesh.
    const auto log_stiffness = [&, elevation = elevation_m, depth = depth_m](double nu) {
      const ProbeFace face{kFaceM, elevation, depth, depth, nu};
      const auto response = make_probed_solid(imaging_device()->queue(), face)->push_homogeneous();
      return Eigen::VectorXd(std::log(response.force_n) - (-response.axial_strain).array().log());
    };
    in.tissue = {kFaceM, depth_m, 0, kNu, Plane::kSolid};
    in.tissue.poisson_std = kStep, in.window_width_m = kFaceM, in.force = {1, kFaceM * elevation_m};
    const Eigen::VectorXd by_cell = log_stiffness(kNu + kStep) - log_stiffness(kNu);
    std::vector<double> of_cells(by_cell.begin(), by_cell.end());
    const double solved = median(of_cells), stated = common_deviation(in, strips, solid);
    std::printf("%.0f mm across, %.0f deep: solved %.4f, stated %.4f\n", 1e3 * elevation_m, 1e3 * depth_m,
                solved, stated);
    EXPECT_GE(stated, 0.9 * solved);
    EXPECT_LE(stated, 1.4 * solved);
  }
}

}  // namespace
}  // namespace teletact::service
