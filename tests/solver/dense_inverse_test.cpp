#include "service/solver/smoother.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>

namespace teletact::service {
namespace {

TEST(DenseInverse, IsTheInverse) {
  const Eigen::Index n = 23;
  const Eigen::MatrixXd b = Eigen::MatrixXd::Random(n, n);
  const Eigen::MatrixXd a = b * b.transpose() + 0.1 * Eigen::MatrixXd::Identity(n, n);
  std::vector<double> matrix(a.data(), a.data() + a.size());
  invert_symmetric(matrix, static_cast<std::size_t>(n));
  const Eigen::MatrixXd product = a * Eigen::Map<Eigen::MatrixXd>(matrix.data(), n, n);
  EXPECT_LE((product - Eigen::MatrixXd::Identity(n, n)).lpNorm<Eigen::Infinity>(), 1e-11);
}

TEST(DenseInverse, LeavesOutWhatNothingHolds) {
  // A chain of springs held nowhere: one pivot sinks to zero; the rest must stay positive definite.
  std::vector<double> matrix{1, -1, 0, -1, 2, -1, 0, -1, 1};
  invert_symmetric(matrix, 3);
  const Eigen::Map<Eigen::Matrix3d> inverse(matrix.data());
  EXPECT_EQ(inverse.row(2).norm(), 0);
  const double determinant = inverse.topLeftCorner<2, 2>().determinant();
  EXPECT_GT(determinant, 0);
  EXPECT_NEAR(inverse(0, 0), 2, 1e-12);
}

}  // namespace
}  // namespace teletact::service
