// A sparse Cholesky factor L L^T that looks up meanwhile (service/device/cancellation.h), row by row as
// Eigen's SimplicialLLT: at the limits it takes seconds, and Eigen's cannot be left before its end. The order
// of a rectangle of cells is nested dissection: it takes no time, and at the limits the factor has a third of
// the operations that Eigen's minimum degree leaves it with.
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <vector>

namespace teletact::service {

// Cells i + nx j in an order of elimination that leaves a factor with little fill: both halves of the
// rectangle before the line between them, and each half so again.
std::vector<int> nested_dissection(std::size_t nx, std::size_t ny);

class SparseFactor {
 public:
  using Sparse = Eigen::SparseMatrix<double>;
  bool analyzed() const { return !column_.empty(); }
  // Serves all matrices of this pattern, symmetric, both halves there. `order`: the unknowns as they are
  // eliminated.
  void analyze(const Sparse&, const std::vector<int>& order);
  // After analyze(). False: not positive definite. A factor that was left is no factor: call it again before
  // solve().
  bool factorize(const Sparse&);
  Eigen::VectorXd solve(const Eigen::VectorXd& b) const;
  // The same of several right-hand sides at once, in a third of the time: L is read once for all.
  using Columns = Eigen::Matrix<double, Eigen::Dynamic, 8, Eigen::RowMajor>;
  Columns solve_columns(const Columns& b) const;
  // Diagonal of the inverse, without the rest of it.
  Eigen::VectorXd inverse_diagonal() const;

 private:
  Sparse ordered(const Sparse&) const;
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> place_;  // of an unknown in the order
  std::vector<int> parent_;                                              // elimination tree; -1: a root
  // L, column by column: where each begins (and the last ends), the diagonal first.
  std::vector<Eigen::Index> column_;
  std::vector<int> row_;
  std::vector<double> value_;
};

}  // namespace teletact::service
