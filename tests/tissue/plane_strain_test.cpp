// The reference assembly (T4) against closed forms: what everything else is compared with must itself be
// right.
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/SparseCholesky>
#include <cmath>

#include "tests/reference/elasticity.h"
#include "tests/reference/kkt.h"
#include "tests/tissue/fields.h"
#include "tests/tissue/tissue_cases.h"

namespace teletact {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;
using reference::Integration;
using service::Material;
using service::Supports;
using service::TissueGrid;
using tests::Manufactured;
using tests::nodal;

TEST(PlaneStrain, PatchTestOnUnevenGrid) {
  const TissueGrid grid = tests::uneven_grid(9, 7);
  for (double nu : {0.0, 0.3, 0.49, 0.4999}) {
    Material material = tests::inclusion(grid, 1, nu);
    const auto k = reference::assemble(grid, material);
    // Any linear displacement is in equilibrium inside; its boundary forces are those of the constant stress.
    const VectorXd u = nodal(grid, [](double x, double y) {
      return Vector2d(1e-3 + 0.02 * x - 0.03 * y, -2e-3 + 0.01 * x + 0.05 * y);
    });
    const VectorXd f = k * u;
    double inside = 0;
    for (std::size_t j = 1; j + 1 < grid.ny(); ++j) {
      for (std::size_t i = 1; i + 1 < grid.nx(); ++i) {
        inside = std::max(inside, f.segment<2>(Index(2 * grid.node(i, j))).cwiseAbs().maxCoeff());
      }
    }
    EXPECT_LE(inside, 1e-11 * f.cwiseAbs().maxCoeff()) << nu;
    const double mu = 1e4 / (2 * (1 + nu)), lambda = 2 * mu * nu / (1 - 2 * nu);
    const double stress_yy = lambda * (0.02 + 0.05) + 2 * mu * 0.05;
    double bottom = 0;
    for (std::size_t i = 0; i < grid.nx(); ++i) bottom += f[Index(2 * grid.node(i, grid.ny() - 1) + 1)];
    // Shear on the two sides cancels; what is left on the bottom is sigma_yy times the width.
    EXPECT_NEAR(bottom, stress_yy * (grid.x_m.back() - grid.x_m.front()), 1e-10 * std::abs(bottom)) << nu;
  }
}

TEST(PlaneStrain, RigidMotionsCarryNoForce) {
  const TissueGrid grid = tests::uneven_grid(6, 8);
  const Material material = tests::scattered(grid, 100, 0.4999);
  const auto k = reference::assemble(grid, material);
  const double scale = k.diagonal().maxCoeff();
  for (const auto& motion : {nodal(grid, [](double, double) { return Vector2d(1, 0); }),
                             nodal(grid, [](double, double) { return Vector2d(0, 1); }),
                             nodal(grid, [](double x, double y) { return Vector2d(-100 * y, 100 * x); })}) {
    EXPECT_LE((k * motion).cwiseAbs().maxCoeff(), 1e-13 * scale);
  }
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen((MatrixXd(k)));
  EXPECT_LE(std::abs(eigen.eigenvalues()[2]), 1e-12 * scale);
  EXPECT_GE(eigen.eigenvalues()[3], 1e-8 * scale);  // exactly three: no hourglass mode
}

TEST(PlaneStrain, StiffnessIsSymmetric) {
  const TissueGrid grid = tests::uneven_grid(7, 5);
  const MatrixXd k = reference::assemble(grid, tests::scattered(grid, 1000, 0.495));
  EXPECT_LE((k - k.transpose()).cwiseAbs().maxCoeff(), 1e-15 * k.cwiseAbs().maxCoeff());
}

// Largest and root-mean-square nodal error of the manufactured solution, over its largest value.
std::pair<double, double> manufactured_error(std::size_t cells, double nu) {
  const Manufactured exact(1e4, nu);
  const TissueGrid grid = tests::uniform_grid(cells + 1, cells + 1, exact.length / double(cells));
  const Material material = tests::inclusion(grid, 1, nu);
  const service::Supports all{service::EdgeSupport::kFixed, service::EdgeSupport::kFixed,
                              service::EdgeSupport::kFixed, service::EdgeSupport::kFixed};
  VectorXd load = reference::body_load(grid, [&](double x, double y) { return exact.force(x, y); });
  const auto fixed = reference::fixed_dofs(grid, all);
  for (std::size_t dof : fixed) load[Index(dof)] = 0;
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor(
      reference::with_fixed(reference::assemble(grid, material), fixed));
  const VectorXd u = factor.solve(load);
  const VectorXd error = u - nodal(grid, [&](double x, double y) { return exact.displacement(x, y); });
  return {error.cwiseAbs().maxCoeff() / 1e-3, error.norm() / std::sqrt(double(error.size())) / 1e-3};
}

TEST(PlaneStrain, ManufacturedSolutionConvergesAtSecondOrder) {
  for (double nu : {0.0, 0.3, 0.45}) {
    const auto coarse = manufactured_error(16, nu), middle = manufactured_error(32, nu),
               fine = manufactured_error(64, nu);
    for (const auto& [a, b] : {std::pair{coarse, middle}, {middle, fine}}) {
      EXPECT_NEAR(std::log2(a.first / b.first), 2, 0.15) << "largest, nu " << nu;
      EXPECT_NEAR(std::log2(a.second / b.second), 2, 0.15) << "rms, nu " << nu;
    }
    EXPECT_LE(fine.first, 0.01);
  }
}

// Bending of a column by a lateral load at its top: its deflection hardly depends on nu; an element that
// locks makes it vanish.
double tip_deflection(double nu, Integration integration) {
  const TissueGrid grid = tests::uniform_grid(9, 33, 1e-3);
  const Material material = tests::inclusion(grid, 1, nu);
  const auto k = reference::with_fixed(reference::assemble(grid, material, integration),
                                       reference::fixed_dofs(grid, Supports{}));
  VectorXd f = VectorXd::Zero(k.rows());
  for (std::size_t i = 0; i < grid.nx(); ++i) f[Index(2 * grid.node(i, 0))] = 1.0 / double(grid.nx());
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor(k);
  const VectorXd u = factor.solve(f);
  return u[Index(2 * grid.node(4, 0))];
}

TEST(PlaneStrain, NoLockingWhereFullIntegrationLocks) {
  const double compressible = tip_deflection(0.3, Integration::kSelectiveReduced);
  // Euler and Bernoulli in plane strain: deflection goes with (1 - nu^2).
  const double expected = compressible * (1 - 0.4999 * 0.4999) / (1 - 0.3 * 0.3);
  EXPECT_NEAR(tip_deflection(0.4999, Integration::kSelectiveReduced) / expected, 1, 0.05);
  EXPECT_LE(tip_deflection(0.4999, Integration::kFull) / expected, 0.2);
  EXPECT_NEAR(tip_deflection(0.3, Integration::kFull) / compressible, 1, 0.05);
}

TEST(Kkt, MultipliersAreReactionsThatBalanceTheSupports) {
  const TissueGrid grid = tests::uneven_grid(9, 6);
  const Material material = tests::scattered(grid, 10, 0.49);
  const auto full = reference::assemble(grid, material);
  const auto k = reference::with_fixed(full, reference::fixed_dofs(grid, Supports{}));
  MatrixXd b = MatrixXd::Zero(2, k.rows());
  b(0, 2 * 4 + 1) = 1;
  b(1, 2 * 5 + 1) = 1;
  const auto solution = reference::solve_kkt(k, b, VectorXd::Zero(k.rows()), Vector2d(2e-3, 1e-3));
  EXPECT_LE((b * solution.x - Vector2d(2e-3, 1e-3)).cwiseAbs().maxCoeff(), 1e-15);
  EXPECT_LE(solution.lambda.sum(), 0);  // pushed along +y: the reaction on the finger is along -y
  double support = 0;                   // axial force of the bottom on the tissue
  const VectorXd force = full * solution.x;
  for (std::size_t i = 0; i < grid.nx(); ++i) support += force[Index(2 * grid.node(i, grid.ny() - 1) + 1)];
  EXPECT_NEAR(support, solution.lambda.sum(), 1e-10 * std::abs(support));
}

}  // namespace
}  // namespace teletact
