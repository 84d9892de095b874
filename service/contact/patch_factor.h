// Cholesky factor of the small matrices of a contact patch. Up to 32 rows it works on sizes that the compiler
// knows, several times faster than a general one; Eigen's takes the larger.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>

namespace teletact::service {

class PatchFactor {
 public:
  // Factors a symmetric matrix (its lower triangle is read) and replaces b by the solution. Throws
  // std::domain_error when the matrix is not positive definite.
  void factor_and_solve(const Eigen::MatrixXd&, Eigen::Ref<Eigen::VectorXd> b);
  // Replaces b by the solution with the last factor.
  void solve(Eigen::Ref<Eigen::VectorXd> b) const;

 private:
  static constexpr int kBlock = 8, kSmall = 32;
  using Column = Eigen::Matrix<double, kSmall, 1>;
  template <int Rows>
  bool factor(const Eigen::MatrixXd&, Column& b);
  void substitute_back(Column& b) const;

  Eigen::Index size_ = 0;
  // A = L D L^T: columns of L, zeros above the unit diagonal and below the last row; D.
  Eigen::Matrix<double, kSmall, kSmall> l_;
  Column pivots_;
  Eigen::LLT<Eigen::MatrixXd> large_;
};

}  // namespace teletact::service
