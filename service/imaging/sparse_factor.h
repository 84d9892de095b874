// A sparse Cholesky factor that looks up meanwhile (service/device/look.h): Eigen's, to the bit, whose loop
// over the rows cannot be left before its end, which comes after tens of seconds at the limits.
#pragma once

#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>

namespace teletact::service {

class SparseFactor : public Eigen::SimplicialLLT<Eigen::SparseMatrix<double>> {
 public:
  using Sparse = Eigen::SparseMatrix<double>;
  // After analyzePattern(). A factor that was left is no factor: call it again before solve().
  void factorize(const Sparse&);
  Eigen::VectorXd solve(const Eigen::VectorXd& b) const;

 private:
  using Base = Eigen::SimplicialLLT<Sparse>;
  void factorize_ordered(const Sparse& upper);
};

}  // namespace teletact::service
