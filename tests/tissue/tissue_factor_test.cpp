// The factor of another modulus as a preconditioner, held to T4.6: eigenvalues and iterations.
#include "service/tissue/tissue_factor.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>
#include <stdexcept>

#include "service/solver/pcg.h"
#include "service/tissue/elasticity.h"
#include "service/tissue/elasticity_solver.h"
#include "tests/reference/elasticity.h"

namespace teletact::service {
namespace {

using Eigen::MatrixXd;

TissueGrid grid_of(std::size_t elements) {
  return {uniform_coordinates(0, 0.03, elements), uniform_coordinates(0, 0.02, elements - 1)};
}

// Every element's modulus times exp(uniform(-1, 1) ln(1 + change)).
Material changed(Material material, double change, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (double& e : material.youngs_modulus_pa) e *= std::pow(1 + change, uniform(random));
  return material;
}

Material uniform_material(const TissueGrid& grid, double nu) {
  return {std::vector<double>(grid.elements(), 10e3), nu};
}

TEST(TissueFactor, SolvesExactlyAndLeavesHeldUnknownsAtZero) {
  const TissueGrid grid = grid_of(9);
  const Material material = changed(uniform_material(grid, 0.499), 30, 1);
  const std::vector<std::uint8_t> free = free_unknowns(grid, {});
  const TissueFactor factor(grid, material, free);
  std::vector<double> u(grid.dofs()), z(grid.dofs());
  for (std::size_t n = 0; n < u.size(); ++n) u[n] = free[n] ? std::sin(static_cast<double>(n)) : 0;
  const Eigen::VectorXd r = reference::assemble(grid, material) *
                            Eigen::Map<Eigen::VectorXd>(u.data(), static_cast<Eigen::Index>(u.size()));
  factor.solve({r.data(), u.size()}, z);
  for (std::size_t n = 0; n < u.size(); ++n) EXPECT_NEAR(z[n], u[n], 1e-9) << n;
}

TEST(TissueFactor, EigenvaluesLieBetweenTheRatiosOfTheModuli) {
  const TissueGrid grid = grid_of(7);
  for (const double nu : {0.3, 0.4999}) {
    const Material old = changed(uniform_material(grid, nu), 5, 1), now = changed(old, 0.5, 2);
    const auto fixed = reference::fixed_dofs(grid, {});
    const MatrixXd k = reference::with_fixed(reference::assemble(grid, now), fixed);
    const MatrixXd k_old = reference::with_fixed(reference::assemble(grid, old), fixed);
    const auto size = static_cast<Eigen::Index>(grid.dofs() - fixed.size());  // the bottom row comes last
    const auto values =
        Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd>(
            k.topLeftCorner(size, size), k_old.topLeftCorner(size, size), Eigen::EigenvaluesOnly)
            .eigenvalues()
            .eval();
    const double bound = TissueFactor(grid, old, free_unknowns(grid, {})).condition(now);
    EXPECT_LE(values.maxCoeff() / values.minCoeff(), bound * (1 + 1e-6)) << nu;
    EXPECT_GE(values.maxCoeff() / values.minCoeff(), 1 + (bound - 1) / 3) << nu;
  }
}

struct Count {
  std::size_t iterations, bound;
};

std::shared_ptr<Device> device() {
  static const std::shared_ptr<Device> opened = Device::open();
  return opened;
}

// Iterations to a relative energy error of 1e-6 under a point load, in double.
Count count(std::size_t elements, const Material& old, const Material& now) {
  constexpr double kGoal = 1e-6;
  const TissueGrid grid = grid_of(elements);
  ElasticitySolverOptions options;
  options.precision = SolvePrecision::kDouble;
  options.relative_error = kGoal;
  ElasticitySolver solver(device(), grid, {}, options);
  const auto factor = std::make_shared<const TissueFactor>(grid, old, solver.free());
  solver.use_factor(factor);
  solver.set_material(now);
  std::vector<double> load(grid.dofs()), u(grid.dofs());
  load[2 * grid.node(grid.nx() / 3, 0) + 1] = 1;
  const SolveReport report = solver.solve(1, load, {}, u);
  EXPECT_TRUE(report.converged) << report.reason;
  // Half of the error is left to rounding, and that it has been reached is seen from the next two steps.
  const std::size_t delay = PcgOptions{}.delay;
  return {report.iterations, most_iterations(factor->condition(now), kGoal / 2) + delay};
}

TEST(TissueFactor, IterationsStayWithinTheBoundWhateverNuAndMesh) {
  if (!device()->queue().supports(Precision::kDouble)) GTEST_SKIP() << "device without double precision";
  // Of T4.6 at nu .495: 5 % -> 5 iterations, 10 % -> 7, 20 % -> 10, 50 % -> 25.
  for (const auto& [change, expected] : {std::pair{0.05, 5U}, {0.1, 7U}, {0.2, 10U}, {0.5, 25U}})
    for (const double nu : {0.3, 0.495, 0.4999})
      for (const std::size_t elements : {12UL, 40UL}) {
        const Material old = changed(uniform_material(grid_of(elements), nu), 9, 3);
        const Count c = count(elements, old, changed(old, change, 4));
        EXPECT_LE(c.iterations, c.bound) << change << " " << nu << " " << elements;
        EXPECT_LE(c.iterations, expected + 2) << "two to see that it is there";
      }
}

TEST(TissueFactor, UniformModulusIsAPreconditionerForContrast) {
  if (!device()->queue().supports(Precision::kDouble)) GTEST_SKIP() << "device without double precision";
  for (const double nu : {0.49, 0.4999}) {
    const Material old = uniform_material(grid_of(40), nu);
    Material now = old;
    for (std::size_t n = 0; n < now.youngs_modulus_pa.size(); ++n)
      now.youngs_modulus_pa[n] *= n / 5 % 3 == 0 ? 10 : 1;
    const Count c = count(40, old, now);
    EXPECT_LE(c.iterations, c.bound) << nu;
    EXPECT_LE(c.iterations, 26U) << nu;
  }
}

TEST(TissueFactor, UnusableFactorsAreRefusedByName) {
  const TissueGrid grid = grid_of(6);
  const Material material = uniform_material(grid, 0.49);
  const std::vector<std::uint8_t> free = free_unknowns(grid, {});
  EXPECT_THROW(TissueFactor(grid, material, {1, 0}), std::invalid_argument);
  EXPECT_THROW(TissueFactor(grid, material, std::vector<std::uint8_t>(grid.dofs(), 1)), std::domain_error);
  ElasticitySolver solver(device(), grid, {}, {});
  solver.set_material(material);
  Supports both;
  both.top = EdgeSupport::kFixed;
  EXPECT_THROW(solver.use_factor(std::make_shared<TissueFactor>(grid, material, free_unknowns(grid, both))),
               std::invalid_argument);
  EXPECT_THROW(solver.use_factor(std::make_shared<TissueFactor>(grid, uniform_material(grid, 0.4), free)),
               std::invalid_argument);
  solver.use_factor(std::make_shared<TissueFactor>(grid, material, free));
  EXPECT_THROW(solver.set_material(uniform_material(grid, 0.4)), std::invalid_argument);
  solver.use_factor(nullptr);
  EXPECT_NO_THROW(solver.set_material(uniform_material(grid, 0.4)));
}

}  // namespace
}  // namespace teletact::service
