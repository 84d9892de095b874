// The factor of another modulus as a preconditioner, held to T4.6: eigenvalues, and iterations of conjugate
// gradients until the energy norm of the error, which is known, has fallen to 1e-6 of the solution's.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <random>

#include "tests/reference/elasticity.h"

namespace teletact::reference {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using service::Material;
using service::TissueGrid;
using Factor = Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>;

TissueGrid grid_of(std::size_t elements) {
  TissueGrid grid;
  for (std::size_t i = 0; i <= elements; ++i) grid.x_m.push_back(0.03 * double(i) / double(elements));
  for (std::size_t j = 0; j < elements; ++j) grid.y_m.push_back(0.02 * double(j) / double(elements - 1));
  return grid;
}

Material uniform_material(const TissueGrid& grid, double nu) {
  return {std::vector<double>(grid.elements(), 10e3), nu};
}

// Every element's modulus times exp(uniform(-1, 1) ln(1 + change)).
Material changed(Material material, double change, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (double& e : material.youngs_modulus_pa) e *= std::pow(1 + change, uniform(random));
  return material;
}

// Greatest over least ratio of the moduli: T4.6's bound of the condition of K_old^-1 K.
double condition(const Material& old, const Material& now) {
  double least = INFINITY, greatest = 0;
  for (std::size_t e = 0; e < old.youngs_modulus_pa.size(); ++e) {
    const double ratio = now.youngs_modulus_pa[e] / old.youngs_modulus_pa[e];
    least = std::min(least, ratio);
    greatest = std::max(greatest, ratio);
  }
  return greatest / least;
}

// Iterations after which 2 ((sqrt c - 1) / (sqrt c + 1))^k <= reduction (Saad, Iterative Methods, eq. 6.128).
int max_iterations(double c, double reduction) {
  const double root = std::sqrt(c);
  return int(std::ceil(std::log(reduction / 2) / std::log((root - 1) / (root + 1))));
}

Eigen::SparseMatrix<double> stiffness(const TissueGrid& grid, const Material& material) {
  return with_fixed(assemble(grid, material), fixed_dofs(grid, {}));
}

// Under a point load on the surface.
int iterations(const TissueGrid& grid, const Material& old, const Material& now) {
  constexpr double kGoal = 1e-6;
  const auto k = stiffness(grid, now);
  const Factor factor(stiffness(grid, old));
  VectorXd r = VectorXd::Zero(k.rows());
  r[Eigen::Index(2 * grid.node(grid.nx() / 3, 0) + 1)] = 1;
  const VectorXd truth = Factor(k).solve(r);
  const auto energy = [&](const VectorXd& v) { return v.dot(k * v); };
  VectorXd x = VectorXd::Zero(r.size()), z = factor.solve(r), p = z;
  for (int n = 0; n < 200; ++n) {
    const double error = energy(truth - x);
    EXPECT_FALSE(std::isnan(error));
    if (error <= kGoal * kGoal * energy(truth)) return n;
    const double rz = r.dot(z);
    const VectorXd kp = k * p;
    x += rz / p.dot(kp) * p;
    r -= rz / p.dot(kp) * kp;
    z = factor.solve(r);
    p = z + r.dot(z) / rz * p;
  }
  return 200;
}

TEST(OldFactor, EigenvaluesLieBetweenTheRatiosOfTheModuli) {
  const TissueGrid grid = grid_of(7);
  for (const double nu : {0.3, 0.4999}) {
    const Material old = changed(uniform_material(grid, nu), 5, 1), now = changed(old, 0.5, 2);
    const MatrixXd k = stiffness(grid, now), k_old = stiffness(grid, old);
    const auto size = Eigen::Index(grid.dofs() - fixed_dofs(grid, {}).size());  // the bottom row comes last
    const VectorXd values =
        Eigen::GeneralizedSelfAdjointEigenSolver<MatrixXd>(
            k.topLeftCorner(size, size), k_old.topLeftCorner(size, size), Eigen::EigenvaluesOnly)
            .eigenvalues();
    const double bound = condition(old, now), found = values.maxCoeff() / values.minCoeff();
    EXPECT_LE(found, bound * (1 + 1e-6)) << nu;
    EXPECT_GE(found, 1 + (bound - 1) / 3) << nu;
  }
}

TEST(OldFactor, IterationsStayWithinTheBoundWhateverNuAndMesh) {
  // T4.6 at nu .495: 5 % -> 5 iterations, 10 % -> 7, 20 % -> 10, 50 % -> 25.
  for (const auto& [change, expected] : {std::pair{0.05, 5}, {0.1, 7}, {0.2, 10}, {0.5, 25}})
    for (const double nu : {0.3, 0.495, 0.4999})
      for (const std::size_t elements : {12UL, 40UL}) {
        const TissueGrid grid = grid_of(elements);
        const Material old = changed(uniform_material(grid, nu), 9, 3), now = changed(old, change, 4);
        const int count = iterations(grid, old, now);
        EXPECT_LE(count, max_iterations(condition(old, now), 1e-6))
            << change << " " << nu << " " << elements;
        EXPECT_LE(count, expected) << change << " " << nu << " " << elements;
      }
}

TEST(OldFactor, UniformModulusIsAPreconditionerForContrast) {
  for (const double nu : {0.49, 0.4999}) {
    const TissueGrid grid = grid_of(40);
    const Material old = uniform_material(grid, nu);
    Material now = old;
    for (std::size_t n = 0; n < now.youngs_modulus_pa.size(); ++n)
      now.youngs_modulus_pa[n] *= n / 5 % 3 == 0 ? 10 : 1;
    const int count = iterations(grid, old, now);
    EXPECT_LE(count, max_iterations(10, 1e-6)) << nu;
    EXPECT_LE(count, 26) << nu;
  }
}

}  // namespace
}  // namespace teletact::reference
