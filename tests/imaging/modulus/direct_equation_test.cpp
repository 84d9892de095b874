#include "service/imaging/modulus/direct_equation.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "tests/reference/adjoint_weighted.h"

namespace teletact::service {
namespace {

TEST(BlockTridiagonal, SolvesWhatADenseMatrixSays) {
  std::srand(3);
  BlockTridiagonal system(5, 3);
  Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(15, 15);
  for (int k = 0; k < 5; ++k) {
    system.diagonal[k] = Eigen::MatrixXd::Random(3, 3) + 4 * Eigen::MatrixXd::Identity(3, 3);
    dense.block(3 * k, 3 * k, 3, 3) = system.diagonal[k];
    if (k > 0) dense.block(3 * k, 3 * k - 3, 3, 3) = system.lower[k] = Eigen::MatrixXd::Random(3, 3);
    if (k < 4) dense.block(3 * k, 3 * k + 3, 3, 3) = system.upper[k] = Eigen::MatrixXd::Random(3, 3);
  }
  const Eigen::MatrixXd x = Eigen::MatrixXd::Random(3, 5);
  const Eigen::VectorXd b = dense * Eigen::Map<const Eigen::VectorXd>(x.data(), 15);
  BlockTridiagonal singular = system;
  const auto solution = system.solve(Eigen::Map<const Eigen::MatrixXd>(b.data(), 3, 5));
  EXPECT_LE((solution.x - x).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_LE(solution.residual, 1e-13);
  singular.diagonal[2].setZero(), singular.lower[2].setZero(), singular.upper[2].setZero();
  EXPECT_THROW(singular.solve(x), std::domain_error);
}

WindowNodes window(std::size_t nx, std::size_t ny, double dx, double dy) {
  StripModel model({dx * double(nx - 1), dy * double(ny - 1), 0, 0.49}, dx * double(nx - 1));
  WindowNodes nodes(model);
  nodes.nx = nx, nodes.ny = ny, nodes.dx_m = dx, nodes.dy_m = dy;
  return nodes;
}

// Random smooth strain about 1 % of compression, moduli about 1.
DirectProblem random_problem(const WindowNodes& nodes, Plane plane) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> part(-0.2, 0.2);
  DirectProblem p;
  p.plane = plane;
  for (std::size_t n = 0; n < nodes.size(); ++n) {
    p.yy.push_back(-0.01 * (1 + part(random)));
    p.xx.push_back(plane == Plane::kStrain ? -p.yy.back() : 0.3 * p.yy.back());
    p.xy.push_back(0.01 * part(random));
    p.shear_modulus.push_back(1 + part(random));
    p.half_pressure.push_back(0.01 * (1 + part(random)));
  }
  return p;
}

class DirectEquation : public ::testing::TestWithParam<Plane> {};

TEST_P(DirectEquation, AgreesWithTheReference) {
  for (const auto& [nx, ny] : {std::pair<std::size_t, std::size_t>{11, 7}, {6, 17}, {3, 3}}) {
    const WindowNodes nodes = window(nx, ny, 1e-3, 0.9e-3);
    const DirectProblem p = random_problem(nodes, GetParam());
    std::vector<double> sorted = p.yy;
    for (double& v : sorted) v = std::abs(v);
    std::nth_element(sorted.begin(), sorted.begin() + std::ptrdiff_t(sorted.size() / 2), sorted.end());
    const auto want =
        reference::solve({nx, ny, nodes.dx_m, nodes.dy_m, GetParam() == Plane::kStrain, p.xx, p.yy, p.xy,
                          sorted[sorted.size() / 2], p.stabilisation, p.shear_modulus, p.half_pressure});
    const DirectSolution got = solve_direct(nodes, p);
    EXPECT_LE(got.residual, 1e-11);
    for (std::size_t n = 0; n < nodes.size(); ++n) {
      EXPECT_NEAR(got.shear_modulus[n], want.mu[n], 1e-8 * (1 + std::abs(want.mu[n]))) << n;
      if (GetParam() == Plane::kStrain) {
        EXPECT_NEAR(got.half_pressure[n], want.half_pressure[n], 1e-9) << n;
      }
    }
  }
}

// Layers under uniform stress: mu(y) yy(y) constant. Their modulus comes back whatever it is, jumps included.
TEST_P(DirectEquation, RecoversLayers) {
  const WindowNodes nodes = window(17, 21, 1e-3, 1e-3);
  DirectProblem p;
  p.plane = GetParam();
  p.stabilisation = 1e-9;
  std::vector<double> truth;
  for (std::size_t n = 0; n < nodes.size(); ++n) {
    const std::size_t j = n / nodes.nx;
    truth.push_back(j >= 8 && j < 13 ? 5.0 : 1.0);
    p.yy.push_back(-0.01 / truth.back());
    p.xx.push_back(GetParam() == Plane::kStrain ? 0.01 / truth.back() : 0.0);
    p.xy.push_back(0);
    p.shear_modulus.push_back(truth.back());
    p.half_pressure.push_back(0.01);  // sigma_xx / 2 = - p / 2 + mu xx = 0
  }
  const DirectSolution got = solve_direct(nodes, p);
  for (std::size_t n = 0; n < nodes.size(); ++n) EXPECT_NEAR(got.shear_modulus[n], truth[n], 1e-4) << n;
}

TEST_P(DirectEquation, WithoutStrainThereIsNoModulus) {
  const WindowNodes nodes = window(5, 5, 1e-3, 1e-3);
  DirectProblem p = random_problem(nodes, GetParam());
  for (auto* field : {&p.xx, &p.yy, &p.xy}) std::fill(field->begin(), field->end(), 0.0);
  EXPECT_THROW(solve_direct(nodes, p), std::domain_error);
}

INSTANTIATE_TEST_SUITE_P(Planes, DirectEquation, ::testing::Values(Plane::kStrain, Plane::kStress));

}  // namespace
}  // namespace teletact::service
