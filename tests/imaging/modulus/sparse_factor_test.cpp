// The factor that looks up agrees with Eigen's, can be left, and its order leaves little fill.
#include "service/imaging/modulus/sparse_factor.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <random>
#include <stdexcept>
#include <utility>
#include <vector>

#include "service/device/cancellation.h"

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

// Our order, for Eigen's own factor of grid(60).
struct Dissection {
  using PermutationType = Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int>;
  template <class Matrix>
  void operator()(const Matrix& a, PermutationType& order) const {
    order.resize(a.cols());
    const std::vector<int> cells = nested_dissection(60, 60);
    std::copy(cells.begin(), cells.end(), order.indices().data());
  }
};

TEST(SparseFactor, IsAsExactAsEigensInTheSameOrder) {
  using Extended = Eigen::Matrix<long double, Eigen::Dynamic, 1>;
  const Sparse a = grid(60);
  const Eigen::VectorXd b = Eigen::VectorXd::LinSpaced(a.rows(), -1, 2);
  const Eigen::SimplicialLLT<Sparse, Eigen::Lower, Dissection> eigen(a);
  Extended truth = eigen.solve(b).cast<long double>();
  for (int k = 0; k < 3; ++k) {
    const Extended left = b.cast<long double>() - a.cast<long double>() * truth;
    truth += eigen.solve(left.cast<double>()).cast<long double>();
  }
  const auto off = [&](const Eigen::VectorXd& x) {
    return static_cast<double>((x.cast<long double>() - truth).cwiseAbs().maxCoeff());
  };
  SparseFactor factor;
  factor.analyze(a, nested_dissection(60, 60));
  for (int again = 0; again < 2; ++again) {
    ASSERT_TRUE(factor.factorize(a));
    EXPECT_LE(off(factor.solve(b)), std::min(1e-12, 2 * off(eigen.solve(b))));
  }
}

TEST(SparseFactor, SolvesSeveralAtOnceAndKnowsTheInversesDiagonal) {
  const Sparse a = grid(23);
  SparseFactor factor;
  factor.analyze(a, nested_dissection(23, 23));
  ASSERT_TRUE(factor.factorize(a));
  const Eigen::MatrixXd inverse = Eigen::MatrixXd(a).inverse();
  EXPECT_LE(((factor.inverse_diagonal() - inverse.diagonal()).cwiseQuotient(inverse.diagonal())).norm(),
            1e-10);
  SparseFactor::Columns b(a.rows(), SparseFactor::Columns::ColsAtCompileTime);
  for (Eigen::Index k = 0; k < b.size(); ++k)
    b(k / b.cols(), k % b.cols()) = std::sin(0.7 * static_cast<double>(k));
  const auto same = [&] {
    EXPECT_LE((factor.solve_columns(b) - inverse * b).norm(), 1e-10 * b.norm() * inverse.norm());
  };
  same();
  b.topRows(b.rows() * 2 / 3).setZero();  // fronts of which all are 0 are left out
  same();
}

TEST(SparseFactor, SaysWhatIsNotPositiveDefinite) {
  Sparse a = grid(10);
  a.coeffRef(17, 17) = -1;
  SparseFactor factor;
  factor.analyze(a, nested_dissection(10, 10));
  EXPECT_FALSE(factor.factorize(a));
}

TEST(SparseFactor, ItsOrderHasEveryCellOnceAndLittleFill) {
  for (const auto& [nx, ny] : {std::pair<std::size_t, std::size_t>{1, 1}, {1, 9}, {7, 2}, {40, 33}}) {
    std::vector<int> order = nested_dissection(nx, ny);
    std::sort(order.begin(), order.end());
    std::vector<int> all(nx * ny);
    std::iota(all.begin(), all.end(), 0);
    EXPECT_EQ(order, all);
  }
  // What is eliminated last separates the rectangle: no cell of one half touches one of the other.
  const std::vector<int> order = nested_dissection(9, 5);
  for (std::size_t n = 40; n < 45; ++n) EXPECT_EQ(order[n] % 9, 4);
}

// However large: of each part of its work, no more than some milliseconds go by without a look.
TEST(SparseFactor, LooksUpAsOftenAsItsWorkGrows) {
  const auto looks = [](int n) {
    const Sparse a = grid(n);
    int count = 0;
    SparseFactor factor;
    const CancellationCheck check([&] { ++count; });
    factor.analyze(a, nested_dissection(static_cast<std::size_t>(n), static_cast<std::size_t>(n)));
    EXPECT_TRUE(factor.factorize(a));
    const int made = count;
    factor.solve(Eigen::VectorXd::Ones(a.rows()));
    return std::pair{made, count - made};
  };
  // Some 8 n^3 multiply-adds of the factor at 2e6 for a look; some 31/4 n^2 log2(n) entries, each met twice.
  const auto [made, solved] = looks(250);
  EXPECT_GE(made, 40);
  EXPECT_GE(solved, 2);
}

TEST(SparseFactor, IsLeftWhenItIsLookedAfterAndCanBeMadeAgain) {
  const Sparse a = grid(120);
  SparseFactor factor;
  factor.analyze(a, nested_dissection(120, 120));
  int looks = 0;
  {
    const CancellationCheck check([&] {
      if (++looks == 3) throw std::runtime_error("left");  // two while it puts the matrix in order
    });
    EXPECT_THROW(factor.factorize(a), std::runtime_error);
  }
  ASSERT_TRUE(factor.factorize(a));
  const Eigen::VectorXd b = Eigen::VectorXd::Ones(a.rows());
  EXPECT_LT((a * factor.solve(b) - b).cwiseAbs().maxCoeff(), 1e-8);
}

}  // namespace
}  // namespace teletact::service
