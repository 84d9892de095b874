// The factor that a contact solve rests on, at every size class that it has.
#include "service/contact/patch_solver.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <random>
#include <stdexcept>

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Index kSizes[] = {1, 2, 7, 8, 9, 16, 17, 24, 25, 32, 33, 60};

// Symmetric positive definite.
MatrixXd random_definite(Index size) {
  std::mt19937 random(static_cast<unsigned>(size));
  std::uniform_real_distribution<double> uniform(-1, 1);
  const MatrixXd b = MatrixXd::NullaryExpr(size, size, [&] { return uniform(random); });
  return b * b.transpose() + MatrixXd::Identity(size, size);
}

TEST(PatchFactor, SolvesWhatADenseFactorSays) {
  for (const Index size : kSizes) {
    const MatrixXd a = random_definite(size);
    const VectorXd first = VectorXd::LinSpaced(size, -1, 2), second = first.cwiseAbs2();
    VectorXd x = first, y = second;
    PatchFactor factor;
    factor.factor_and_solve(a, x);
    factor.solve(y);
    EXPECT_LE((a * x - first).norm(), 1e-11 * first.norm()) << size;
    EXPECT_LE((a * y - second).norm(), 1e-11 * second.norm()) << size;
  }
}

TEST(PatchFactor, MatrixThatIsNotPositiveDefiniteIsRefused) {
  for (const Index size : kSizes) {
    MatrixXd a = random_definite(size);
    a(size - 1, size - 1) = -1;
    VectorXd x = VectorXd::Ones(size);
    EXPECT_THROW(PatchFactor().factor_and_solve(a, x), std::domain_error) << size;
  }
}

}  // namespace
}  // namespace teletact::service
