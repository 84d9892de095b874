// Shares of a contact's force in the elements (T9.2), and what tissue is felt to be by them.
#include "service/tissue/solid/element_shares.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <numeric>

#include "service/tissue/solid/solid_solver.h"
#include "tests/reference/solid.h"
#include "tests/solver/block_stencil.h"
#include "tests/tissue/solid/solids.h"

namespace teletact::service {
namespace {

std::vector<double> to_vector(const Eigen::VectorXd& v) {
  return {v.begin(), v.end()};
}

// Some nodes of the surface pushed down by different depths, as a bonded tip would.
struct Pushed {
  explicit Pushed(const SolidTissue& tissue) : tissue(tissue), truth(tissue) {
    for (std::size_t k = 3; k < 6; ++k)
      for (std::size_t i = 6; i < 9; ++i) unknowns.push_back(reference::unknown(tissue.grid, i, 0, k, 1));
    depth_m = Eigen::VectorXd::LinSpaced(Eigen::Index(unknowns.size()), 1e-3, 2e-3);
    s = truth.compliance(unknowns).ldlt();
  }
  double force_n() const { return s.solve(depth_m).sum(); }
  std::vector<double> field(const Eigen::VectorXd& w) const {
    const Eigen::VectorXd p = s.solve(w);
    Eigen::VectorXd load = Eigen::VectorXd::Zero(truth.stiffness().rows());
    for (Eigen::Index n = 0; n < p.size(); ++n) load[Eigen::Index(unknowns[std::size_t(n)])] = p[n];
    return to_vector(truth.solve(load));
  }
  std::vector<double> shares() const {
    return work_of_elements(tissue, field(depth_m), field(Eigen::VectorXd::Ones(depth_m.size())));
  }
  SolidTissue tissue;
  reference::SolidReference truth;
  std::vector<std::size_t> unknowns;
  Eigen::VectorXd depth_m;
  Eigen::LDLT<Eigen::MatrixXd> s;
};

TEST(ForceShares, SumToTheForceAndAreItsDerivatives) {
  const SolidTissue tissue = rough(small_grid(), 0.49, 10);
  const Pushed pushed(tissue);
  const std::vector<double> g = pushed.shares();
  const double force = pushed.force_n();
  EXPECT_NEAR(std::accumulate(g.begin(), g.end(), 0.0), force, 1e-10 * force);
  // Every element stiffer or softer by a little: the force follows the shares.
  SolidTissue changed = tissue;
  double foreseen = 0;
  constexpr double kStep = 1e-4;
  for (std::size_t e = 0; e < g.size(); ++e) {
    const double by = kStep * (e % 3 == 0 ? 1 : -0.5 * double(e % 2));
    changed.youngs_modulus_pa[e] *= std::exp(by);
    foreseen += g[e] * by;
  }
  EXPECT_NEAR(Pushed(changed).force_n() - force, foreseen, 0.01 * std::abs(foreseen));
}

class FeltForceTest : public testing::Test {
 protected:
  // 32 x 32 columns of 2 mm, so that there is room for contacts of several radii.
  FeltForceTest()
      : grid{32, 32, 0.002, 0.002, graded_rows(0.020, 8, 1.2)},
        layers(solid(grid, 0.49, [](double, double y, double) { return y < 0.006 ? 3e4 : 1e4; })),
        queue(test_device()->queue()),
        solver(queue, layers),
        shares(queue, grid, solver.layers(), 0.49, [this](const auto& unknowns, const auto& force_n) {
          solver.load(unknowns, force_n, {.relative_error = HUGE_VAL, .max_iterations = 0});
          return solver.displacement();
        }) {}
  SolidGrid grid;
  SolidTissue layers;
  Queue queue;
  SolidSolver<float> solver;
  ForceShares shares;
};

TEST_F(FeltForceTest, OfLayersIsNothingAndOfAllTissueStifferIsThat) {
  const FeltForce same = shares.felt(layers), stiffer = shares.felt(layers, 2);
  for (const double a : {0.0005, 0.003, 0.02}) {
    EXPECT_NEAR(same.at(0.013, 0.031, a).log_mean, 0, 1e-6);
    EXPECT_NEAR(same.at(0.013, 0.031, a).log_variance, 0, 1e-6);
    EXPECT_NEAR(stiffer.at(0.013, 0.031, a).log_mean, std::log(2), 1e-5);
    EXPECT_NEAR(stiffer.at(0.013, 0.031, a).log_variance, 0, 1e-5);
  }
}

// By the definition: shares about a node times the map around it, summed one by one.
TEST_F(FeltForceTest, IsTheMeanWithTheSharesAboutEachNode) {
  SolidTissue tissue = layers;
  const SolidTissue some = rough(grid, 0.49, 5);
  for (std::size_t e = 0; e < tissue.youngs_modulus_pa.size(); ++e)
    tissue.youngs_modulus_pa[e] *= some.youngs_modulus_pa[e] / 2e4;
  const FeltForce felt = shares.felt(tissue);
  for (const double radius : {0.0025, 0.0063}) {
    const ForceShares::Contact contact = ForceShares::contact(grid, radius);
    const auto field = [&](const Eigen::VectorXd& p) {
      solver.load(contact.unknowns, p, {.relative_error = HUGE_VAL, .max_iterations = 0});
      return solver.displacement();
    };
    const std::vector<double> g = work_of_elements(layers, field(contact.hertz_n), field(contact.punch_n));
    const double sum = std::accumulate(g.begin(), g.end(), 0.0);
    for (const auto& [i, k] : {std::pair{0, 0}, std::pair{5, 30}, std::pair{31, 9}}) {
      double mean = 0, square = 0;
      for (std::size_t j = 0; j < grid.layers(); ++j)
        for (std::size_t z = 0; z < grid.nz; ++z)
          for (std::size_t x = 0; x < grid.nx; ++x) {
            const std::size_t own = (j * grid.nz + z) * grid.nx + x;
            const std::size_t at =
                (j * grid.nz + (z + std::size_t(k)) % grid.nz) * grid.nx + (x + std::size_t(i)) % grid.nx;
            const double m = std::log(tissue.youngs_modulus_pa[at] / layers.youngs_modulus_pa[at]);
            mean += g[own] / sum * m, square += g[own] / sum * m * m;
          }
      const FeltForce::At here = felt.at(i * grid.spacing_x_m, k * grid.spacing_z_m, radius);
      EXPECT_NEAR(here.log_mean, mean, 2e-5);
      EXPECT_NEAR(here.log_variance, square - mean * mean, 5e-5);
    }
  }
}

TEST_F(FeltForceTest, ItsDerivativesAreThoseOfTheMean) {
  const FeltForce felt = shares.felt(rough(grid, 0.49, 5));
  constexpr double kX = 0.0171, kZ = 0.0232, kA = 0.0033, kStep = 1e-5;
  const auto mean = [&](double x, double z, double a) { return felt.at(x, z, a).log_mean; };
  const FeltForce::At at = felt.at(kX, kZ, kA);
  const double slope_x = (mean(kX + kStep, kZ, kA) - mean(kX - kStep, kZ, kA)) / (2 * kStep);
  EXPECT_NEAR(at.slope[0], slope_x, 1e-4 * std::abs(slope_x));
  const auto by_x = [&](double x, double z) { return felt.at(x, z, kA).slope[0]; };
  const auto by_z = [&](double x, double z) { return felt.at(x, z, kA).slope[1]; };
  const double curved = at.curvature.norm();
  EXPECT_NEAR(at.curvature(0, 0), (by_x(kX + kStep, kZ) - by_x(kX - kStep, kZ)) / (2 * kStep), 1e-4 * curved);
  EXPECT_NEAR(at.curvature(0, 1), (by_x(kX, kZ + kStep) - by_x(kX, kZ - kStep)) / (2 * kStep), 1e-4 * curved);
  EXPECT_NEAR(at.curvature(1, 1), (by_z(kX, kZ + kStep) - by_z(kX, kZ - kStep)) / (2 * kStep), 1e-4 * curved);
  EXPECT_NEAR(at.by_log_radius, (mean(kX, kZ, kA * 1.0001) - mean(kX, kZ, kA / 1.0001)) / 2e-4, 1e-4);
}

}  // namespace
}  // namespace teletact::service
