// Condensation of the tissue onto one line of nodes (T4.2, T4.4): layer-by-layer block elimination.
//
// Ordered by lines of nodes, K is block tridiagonal: own blocks D_j, couplings E_j = K(j, j+1) that reach
// three nodes. With everything below line j eliminated, B_j = D_j - E_j B_{j+1}^-1 E_j^T; with everything
// above, A_j = D_j - E_{j-1}^T A_{j-1}^-1 E_{j-1}. Line j then sees the Schur complement A_j + B_j - D_j
// (above + own + below), whose inverse is the compliance among its nodes: exact, whatever the line. Cost per
// line: one dense symmetric inverse (m^3 flops, m = 2 nx) and O(m^2) for the sparse couplings.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "service/tissue/grid.h"

namespace teletact::service {

// Replaces the lower triangle of the symmetric positive definite `a` by that of its inverse, by recursive
// 2x2 blocks (all work in matrix products); the upper triangle is left alone. Throws std::domain_error when a
// pivot is not positive or not finite.
void invert_symmetric(Eigen::Ref<Eigen::MatrixXd> a);

// A block that couples every node of one line to three nodes of a neighbouring one: row 2 i + a holds the
// entries towards the degrees of freedom 2 (i-1) ... 2 (i+1) + 1; what falls outside is zero.
struct LineCoupling {
  Eigen::Matrix<double, Eigen::Dynamic, 6, Eigen::RowMajor> band;
  LineCoupling transposed() const;
};

// The block tridiagonal stiffness over free degrees of freedom: fixed lines and columns are left out.
class LayeredStiffness {
 public:
  // Throws std::invalid_argument when the inputs are unusable or no edge is fixed (a free body has no
  // compliance).
  LayeredStiffness(const TissueGrid&, const Material&, const Supports&);
  std::size_t first_line() const { return first_line_; }  // free lines, inclusive
  std::size_t last_line() const { return last_line_; }
  std::size_t first_column() const { return first_column_; }  // free columns, inclusive
  std::size_t last_column() const { return last_column_; }
  Eigen::Index size() const { return Eigen::Index(2 * (last_column_ - first_column_ + 1)); }
  Eigen::MatrixXd own(std::size_t line) const;          // D_j, size x size
  LineCoupling coupling_below(std::size_t line) const;  // E_j, line < last_line()
  // B_j of the first free line: its stiffness with all lines below it eliminated; the lower triangle. `kept`
  // (may be null) gets B_j of every free line, in order, for condensed_lines.
  Eigen::MatrixXd eliminated_below(std::vector<Eigen::MatrixXd>* kept) const;
  // A_j + B_j - D_j of every free line, in order from first_line(); lower triangles. `below`: B_j of every
  // free line where they are known, else empty.
  std::vector<Eigen::MatrixXd> condensed_lines(std::vector<Eigen::MatrixXd> below) const;

 private:
  void add_own(std::size_t line, Eigen::MatrixXd& block) const;
  const TissueGrid& grid_;
  const Material& material_;
  std::size_t first_line_ = 0, last_line_ = 0, first_column_ = 0, last_column_ = 0;
};

}  // namespace teletact::service
