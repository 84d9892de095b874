// The factor that looks up is Eigen's to the bit, and can be left.
#include "service/imaging/sparse_factor.h"

#include <gtest/gtest.h>

#include <random>
#include <stdexcept>
#include <vector>

#include "service/device/look.h"

namespace teletact::service {
namespace {

using Sparse = SparseFactor::Sparse;

// A grid of n x n unknowns, each coupled to its neighbours by random weights.
Sparse grid(int n) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> weight(0.1, 10);
  std::vector<Eigen::Triplet<double>> entries;
  const auto couple = [&](int a, int b) {
    const double w = weight(random);
    entries.emplace_back(a, a, w), entries.emplace_back(b, b, w);
    entries.emplace_back(a, b, -w), entries.emplace_back(b, a, -w);
  };
  for (int j = 0; j < n; ++j)
    for (int i = 0; i < n; ++i) {
      entries.emplace_back(i + n * j, i + n * j, 0.01);
      if (i + 1 < n) couple(i + n * j, i + 1 + n * j);
      if (j + 1 < n) couple(i + n * j, i + n * (j + 1));
    }
  Sparse a(n * n, n * n);
  a.setFromTriplets(entries.begin(), entries.end());
  return a;
}

TEST(SparseFactor, IsEigensToTheBit) {
  const Sparse a = grid(60);
  const Eigen::VectorXd b = Eigen::VectorXd::LinSpaced(a.rows(), -1, 2);
  Eigen::SimplicialLLT<Sparse> eigen(a);
  SparseFactor factor;
  factor.analyzePattern(a);
  for (int again = 0; again < 2; ++again) {
    factor.factorize(a);
    ASSERT_EQ(factor.info(), Eigen::Success);
    EXPECT_EQ((factor.solve(b) - eigen.solve(b)).cwiseAbs().maxCoeff(), 0);
  }
}

TEST(SparseFactor, SaysWhatIsNotPositiveDefinite) {
  Sparse a = grid(10);
  a.coeffRef(17, 17) = -1;
  SparseFactor factor;
  factor.analyzePattern(a);
  factor.factorize(a);
  EXPECT_EQ(factor.info(), Eigen::NumericalIssue);
}

TEST(SparseFactor, IsLeftWhenItIsLookedAfterAndCanBeMadeAgain) {
  const Sparse a = grid(120);
  SparseFactor factor;
  factor.analyzePattern(a);
  int looks = 0;
  {
    const Looking looking([&] {
      if (++looks == 2) throw std::runtime_error("left");
    });
    EXPECT_THROW(factor.factorize(a), std::runtime_error);
  }
  factor.factorize(a);
  const Eigen::VectorXd b = Eigen::VectorXd::Ones(a.rows());
  EXPECT_LT((a * factor.solve(b) - b).cwiseAbs().maxCoeff(), 1e-8);
}

}  // namespace
}  // namespace teletact::service
