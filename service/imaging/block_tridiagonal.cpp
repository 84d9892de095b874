#include "service/imaging/block_tridiagonal.h"

#include <Eigen/LU>
#include <stdexcept>
#include <utility>

#include "service/device/look.h"

namespace teletact::service {

BlockTridiagonal::BlockTridiagonal(Eigen::Index count, Eigen::Index size) {
  for (Eigen::Index k = 0; k < count; ++k) {
    look();  // at the limits these are 2 GB
    for (auto* blocks : {&diagonal, &lower, &upper}) blocks->push_back(Eigen::MatrixXd::Zero(size, size));
  }
}

// D_0 = diagonal_0, D_k = diagonal_k - lower_k D_(k-1)^-1 upper_(k-1); then backwards.
BlockTridiagonal::Solution BlockTridiagonal::solve(const Eigen::MatrixXd& b) const {
  const std::size_t count = diagonal.size();
  std::vector<Eigen::MatrixXd> carry(count);  // D_k^-1 upper_k
  Eigen::MatrixXd y = b;
  Eigen::MatrixXd d = diagonal[0];
  for (std::size_t k = 0; k < count; ++k) {
    look();
    const auto column = static_cast<Eigen::Index>(k);
    const Eigen::PartialPivLU<Eigen::MatrixXd> lu(d);
    y.col(column) = lu.solve(y.col(column)).eval();
    if (!y.col(column).allFinite()) throw std::domain_error("a block of the system is singular");
    if (k + 1 == count) break;
    look();
    carry[k] = lu.solve(upper[k]);
    look();
    d = diagonal[k + 1];
    d.noalias() -= lower[k + 1] * carry[k];
    y.col(column + 1).noalias() -= lower[k + 1] * y.col(column);
  }
  for (std::size_t k = count - 1; k-- > 0;)
    y.col(static_cast<Eigen::Index>(k)).noalias() -= carry[k] * y.col(static_cast<Eigen::Index>(k) + 1);
  Solution out{std::move(y), 0};
  Eigen::MatrixXd residual = b;
  for (std::size_t k = 0; k < count; ++k) {
    const auto column = static_cast<Eigen::Index>(k);
    residual.col(column) -= diagonal[k] * out.x.col(column);
    if (k > 0) residual.col(column) -= lower[k] * out.x.col(column - 1);
    if (k + 1 < count) residual.col(column) -= upper[k] * out.x.col(column + 1);
  }
  if (b.norm() > 0) out.residual = residual.norm() / b.norm();
  return out;
}

}  // namespace teletact::service
