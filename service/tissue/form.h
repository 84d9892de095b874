// Two forms left^T S right of a matrix kept in float.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <span>

namespace teletact::service {

// Over rows and columns `unknowns` - first of S.
inline Eigen::Vector2d forms_of(const Eigen::MatrixXf& s, Eigen::Index first,
                                std::span<const std::size_t> unknowns, const Eigen::MatrixX2d& left,
                                const Eigen::VectorXd& right) {
  using Eigen::Index;
  const Index n = right.size();
  Eigen::Vector2d forms = Eigen::Vector2d::Zero();
  for (Index b = 0; b < n; ++b) {
    const float* column = s.col(Index(unknowns[std::size_t(b)]) - first).data();
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    for (Index a = 0; a < n; ++a)
      sum += double(column[Index(unknowns[std::size_t(a)]) - first]) * left.row(a).transpose();
    forms += right[b] * sum;
  }
  return forms;
}

}  // namespace teletact::service
