// A sparse Cholesky factor L L^T that looks up meanwhile (service/device/cancellation.h), multifrontal (Duff
// and Reid, ACM Trans. Math. Softw. 9, 1983): columns with the same rows below them are eliminated together,
// in a dense matrix. That takes 0.3 to 0.45 of the time of row by row on windows, 0.15 on 400 x 200 nodes;
// CHOLMOD takes longer, and cannot be left before its end. The order of a rectangle of cells is nested
// dissection: it takes no time, and at the limits the factor has a third of the operations that Eigen's
// minimum degree leaves it with.
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
  bool analyzed() const { return analyzed_; }
  // Serves all matrices of this pattern, symmetric, both halves there. `order`: the unknowns as they are
  // eliminated. One that was left is none: call it again before factorize().
  void analyze(const Sparse&, const std::vector<int>& order);
  // After analyze(). False: not positive definite. A factor that was left is no factor: call it again before
  // solve().
  bool factorize(const Sparse&);
  Eigen::VectorXd solve(const Eigen::VectorXd& b) const;
  // The same of several right-hand sides at once, in a third of the time or less: L is read once for all.
  using Columns = Eigen::Matrix<double, Eigen::Dynamic, 16, Eigen::RowMajor>;
  Columns solve_columns(const Columns& b) const;
  // Diagonal of the inverse, without the rest of it.
  Eigen::VectorXd inverse_diagonal() const;

 private:
  Sparse ordered(const Sparse&) const;
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> place_;  // of an unknown in the order
  // Columns [first, end) of L that have the same rows from `end` on.
  struct Front {
    int first = 0, end = 0;
    std::vector<std::size_t> below;  // fronts whose first such row is one of its columns
  };
  std::vector<int> parents(const Sparse& lower, std::vector<int>& entries) const;
  void add_rows(const Sparse& lower, const Front&, std::vector<int>& seen);
  Eigen::Index rows_of(const Front& f) const {
    const auto k = static_cast<std::size_t>(f.first);
    return column_[k + 1] - column_[k];
  }
  bool analyzed_ = false;
  std::vector<Front> fronts_;
  // L, column by column: where each begins (and the last ends), the diagonal first, rows increasing.
  std::vector<Eigen::Index> column_;
  std::vector<int> row_;
  std::vector<double> value_;
};

}  // namespace teletact::service
