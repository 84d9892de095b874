// The modulus peers of the elastography chart do what they claim, on displacement without noise.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "bench/peers/modulus_peer.h"
#include "bench/peers/patch_forward.h"
#include "bench/phantoms/metrics.h"

namespace teletact::bench {
namespace {

constexpr double kWindowM = 0.060, kDepthM = 0.040;

// The true displacement of a phantom on a coarse image grid.
Track truth_of(const Phantom& p) {
  Track t;
  t.grid = {80, 53, 0.375e-3, 0.375e-3, 0.75e-3, 0.75e-3};
  for (std::size_t n = 0; n < t.grid.size(); ++n) {
    t.axial_m.push_back(p.displacement_m(t.grid.origin_x_m + static_cast<double>(n % t.grid.nx) * t.grid.dx_m,
                                         t.grid.origin_y_m + static_cast<double>(n / t.grid.nx) * t.grid.dy_m)
                            .y);
    t.valid.push_back(1);
  }
  return t;
}

ModulusQuality judge(const ModulusPeer& peer, const Phantom& p) {
  const Track t = truth_of(p);
  const std::vector<double> strain = true_axial_strain(t.grid, p);
  const auto modulus =
      peer.estimate({t, strain, kWindowM, kDepthM, p.tissue, {p.force_n, p.contact_area_m2}});
  return modulus_quality(modulus, t.grid, p);
}

TEST(InverseStrain, IsPressureOverStrain) {
  Track t;
  t.grid = {12, 12, 0, 0, 1e-3, 1e-3};
  std::vector<double> strain(t.grid.size(), -0.01);
  strain[0] = std::numeric_limits<double>::quiet_NaN();
  strain[1] = -1e-5;  // says nothing
  const auto modulus = make_inverse_strain().estimate({t, strain, 0.06, 0.04, {}, {0.06, 6e-4}});
  EXPECT_TRUE(std::isnan(modulus[0]));
  EXPECT_TRUE(std::isnan(modulus[1]));
  EXPECT_NEAR(modulus[70], 10e3, 1);
}

TEST(InverseStrain, KeepsOnlyPartOfTheContrast) {
  const Phantom p = Phantoms().make({.contrast = 5, .tissue_width_m = 0.160}, 1);
  const ModulusQuality q = judge(make_inverse_strain(), p);
  EXPECT_GT(q.contrast, 2);
  EXPECT_LT(q.contrast, 4);  // (5 + 1) / 2 in plane strain
}

TEST(PatchForward, HomogeneousBlockAnswersAsItsForceSays) {
  PatchForward forward({kWindowM, kDepthM, 0, 0.3}, kWindowM, kDepthM);
  const auto count = static_cast<Eigen::Index>(forward.patches());
  const auto soft = forward.respond(Eigen::VectorXd::Constant(count, 1.0));
  const auto hard = forward.respond(Eigen::VectorXd::Constant(count, 2.0));
  EXPECT_NEAR(hard.force_n_per_m, 2 * soft.force_n_per_m, 1e-9 * hard.force_n_per_m);
  EXPECT_LE((hard.axial - soft.axial).cwiseAbs().maxCoeff(), 1e-10);
  // Between free sides that slide (E / (1 - nu^2)) and sides that are held (the oedometer modulus).
  const double nominal = kWindowM / kDepthM;
  EXPECT_GT(soft.force_n_per_m, nominal);
  EXPECT_LT(soft.force_n_per_m, nominal * 0.7 / (1.3 * 0.4));
}

TEST(GaussNewton, RecoversTheContrastThatInverseStrainLoses) {
  const Phantom p = Phantoms().make({.contrast = 3, .diameter_m = 0.015, .tissue_width_m = 0.160}, 1);
  const ModulusQuality q = judge(make_gauss_newton(), p), naive = judge(make_inverse_strain(), p);
  EXPECT_GT(q.contrast, 2.5);
  EXPECT_GT(q.contrast, naive.contrast + 0.5);
  EXPECT_LT(q.contrast, 3.3);
  EXPECT_NEAR(q.background, 10e3, 500);
  EXPECT_GT(q.dice, 0.8);
}

}  // namespace
}  // namespace teletact::bench
