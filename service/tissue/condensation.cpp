#include "service/tissue/condensation.h"

#include <Eigen/Cholesky>
#include <array>
#include <stdexcept>

#include "service/tissue/element.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

constexpr Index kSmallestSplit = 32;  // below it a plain Cholesky factor is faster than splitting further

[[noreturn]] void not_positive_definite() {
  throw std::domain_error(
      "condensation: the tissue stiffness is not positive definite in double precision; check the supports "
      "and "
      "reduce the modulus contrast");
}

void invert_small(Eigen::Ref<MatrixXd> a) {
  const Eigen::LLT<MatrixXd, Eigen::Lower> factor(a);
  if (factor.info() != Eigen::Success || !factor.matrixLLT().diagonal().allFinite()) not_positive_definite();
  const MatrixXd inverse = factor.solve(MatrixXd::Identity(a.rows(), a.cols()));
  a.triangularView<Eigen::Lower>() = inverse;
}

void copy_lower_to_upper(MatrixXd& a) {
  a.triangularView<Eigen::StrictlyUpper>() = a.transpose();
}

// product.col(2i+a) = sum_k x.col(2(i-1)+k) band(2i+a, k), that is x E^T.
MatrixXd times_transposed(const MatrixXd& x, const LineCoupling& e) {
  const Index size = x.cols();
  MatrixXd product = MatrixXd::Zero(x.rows(), size);
  for (Index row = 0; row < size; ++row) {
    const Index first = 2 * (row / 2) - 2;
    for (Index k = 0; k < 6; ++k) {
      const Index column = first + k;
      if (column < 0 || column >= size) continue;
      product.col(row) += e.band(row, k) * x.col(column);
    }
  }
  return product;
}

// Schur complement own - E neighbour^-1 E^T; destroys `neighbour`.
MatrixXd eliminate(MatrixXd& neighbour, const MatrixXd& own, const LineCoupling& e) {
  invert_symmetric(neighbour);
  copy_lower_to_upper(neighbour);
  const MatrixXd half = times_transposed(neighbour, e).transpose();  // E X, X symmetric
  return own - times_transposed(half, e);
}

}  // namespace

void invert_symmetric(Eigen::Ref<MatrixXd> a) {
  const Index n = a.rows();
  if (n <= kSmallestSplit) return invert_small(a);
  const Index n1 = n / 2, n2 = n - n1;
  // a = [A B^T; B C]. With X = A^-1, Y = B X, Z = (C - Y B^T)^-1:
  // a^-1 = [X + Y^T Z Y, .; -Z Y, Z].
  auto x = a.topLeftCorner(n1, n1);
  auto b = a.bottomLeftCorner(n2, n1);
  auto c = a.bottomRightCorner(n2, n2);
  invert_symmetric(x);
  MatrixXd full = x.selfadjointView<Eigen::Lower>();
  const MatrixXd y = b * full;
  c.triangularView<Eigen::Lower>() -= y * b.transpose();
  invert_symmetric(c);
  full = c.selfadjointView<Eigen::Lower>();
  b.noalias() = -full * y;
  x.triangularView<Eigen::Lower>() -= y.transpose() * b;
}

LineCoupling LineCoupling::transposed() const {
  const Index nodes = band.rows() / 2;
  LineCoupling t;
  t.band.setZero(band.rows(), 6);
  for (Index i = 0; i < nodes; ++i) {
    for (Index neighbour = std::max<Index>(0, i - 1); neighbour <= std::min(nodes - 1, i + 1); ++neighbour) {
      t.band.block<2, 2>(2 * i, 2 * (neighbour - i + 1)) =
          band.block<2, 2>(2 * neighbour, 2 * (i - neighbour + 1)).transpose();
    }
  }
  return t;
}

LayeredStiffness::LayeredStiffness(const TissueGrid& grid, const Material& material, const Supports& supports)
    : grid_(grid), material_(material) {
  validate(grid, material);
  const auto fixed = [](EdgeSupport edge) { return edge == EdgeSupport::kFixed; };
  if (!fixed(supports.top) && !fixed(supports.bottom) && !fixed(supports.left) && !fixed(supports.right)) {
    throw std::invalid_argument(
        "supports: no edge is fixed, so the tissue would fly away when touched; fix at least one edge, for "
        "example the bottom");
  }
  first_line_ = fixed(supports.top) ? 1 : 0;
  first_column_ = fixed(supports.left) ? 1 : 0;
  const std::size_t end_line = grid.ny() - (fixed(supports.bottom) ? 1 : 0);
  const std::size_t end_column = grid.nx() - (fixed(supports.right) ? 1 : 0);
  if (end_line <= first_line_ || end_column <= first_column_) {
    throw std::invalid_argument("supports: every node is fixed; leave an edge free or use a finer grid");
  }
  last_line_ = end_line - 1;
  last_column_ = end_column - 1;
}

MatrixXd LayeredStiffness::own(std::size_t line) const {
  MatrixXd block = MatrixXd::Zero(size(), size());
  const auto add_row = [&](std::size_t row, int local) {  // element row; its top (0) or bottom (2) nodes
    const double height = grid_.y_m[row + 1] - grid_.y_m[row];
    for (std::size_t i = 0; i + 1 < grid_.nx(); ++i) {
      const auto k =
          element_stiffness(grid_.x_m[i + 1] - grid_.x_m[i], height,
                            material_.youngs_modulus_pa[grid_.element(i, row)], material_.poisson_ratio);
      const bool left = i >= first_column_, right = i + 1 <= last_column_;
      const Index at = 2 * (Index(i) - Index(first_column_));
      if (left) block.block<2, 2>(at, at) += k.block<2, 2>(2 * local, 2 * local);
      if (right) block.block<2, 2>(at + 2, at + 2) += k.block<2, 2>(2 * local + 2, 2 * local + 2);
      if (left && right) {
        block.block<2, 2>(at, at + 2) += k.block<2, 2>(2 * local, 2 * local + 2);
        block.block<2, 2>(at + 2, at) += k.block<2, 2>(2 * local + 2, 2 * local);
      }
    }
  };
  if (line + 1 < grid_.ny()) add_row(line, 0);
  if (line > 0) add_row(line - 1, 2);
  return block;
}

LineCoupling LayeredStiffness::coupling_below(std::size_t line) const {
  LineCoupling e;
  e.band.setZero(size(), 6);
  const double height = grid_.y_m[line + 1] - grid_.y_m[line];
  for (std::size_t i = 0; i + 1 < grid_.nx(); ++i) {
    const auto k =
        element_stiffness(grid_.x_m[i + 1] - grid_.x_m[i], height,
                          material_.youngs_modulus_pa[grid_.element(i, line)], material_.poisson_ratio);
    const bool free_node[2] = {i >= first_column_, i + 1 <= last_column_};
    const Index at = 2 * (Index(i) - Index(first_column_));
    for (int top = 0; top < 2; ++top) {
      for (int bottom = 0; bottom < 2; ++bottom) {
        if (!free_node[top] || !free_node[bottom]) continue;
        e.band.block<2, 2>(at + 2 * top, 2 * (bottom - top + 1)) += k.block<2, 2>(2 * top, 4 + 2 * bottom);
      }
    }
  }
  return e;
}

MatrixXd LayeredStiffness::eliminated_below(std::size_t line) const {
  MatrixXd stiffness = own(last_line_);
  for (std::size_t j = last_line_; j-- > line;) {
    stiffness = eliminate(stiffness, own(j), coupling_below(j));
  }
  return stiffness;
}

std::vector<MatrixXd> LayeredStiffness::condensed_lines() const {
  std::vector<MatrixXd> lines(last_line_ - first_line_ + 1);
  lines.back() = own(last_line_);
  for (std::size_t j = last_line_; j-- > first_line_;) {
    MatrixXd below = lines[j + 1 - first_line_];
    lines[j - first_line_] = eliminate(below, own(j), coupling_below(j));
  }
  MatrixXd above = own(first_line_);  // A_j, from the top down
  for (std::size_t j = first_line_ + 1; j <= last_line_; ++j) {
    const MatrixXd own_block = own(j);
    above = eliminate(above, own_block, coupling_below(j - 1).transposed());
    lines[j - first_line_] += above - own_block;
  }
  return lines;
}

}  // namespace teletact::service
