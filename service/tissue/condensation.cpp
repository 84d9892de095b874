#include "service/tissue/condensation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "service/tissue/element.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

constexpr Index kLeaf = 32;  // below it a sweep in registers and L1 is faster than splitting further

[[noreturn]] void not_positive_definite() {
  throw std::domain_error(
      "condensation: the tissue stiffness is not positive definite in double precision; check the supports "
      "and "
      "reduce the modulus contrast");
}

// By a Cholesky factor L, W = L^-T and W W^T, on a size known to the compiler (padded by zeros). A
// Gauss-Jordan sweep loses a digit near nu = 1/2.
void invert_small(Eigen::Ref<MatrixXd> a) {
  using Small = Eigen::Matrix<double, kLeaf, kLeaf>;
  const Index n = a.rows();
  Small l = Small::Zero(), w = Small::Zero();
  l.topLeftCorner(n, n) = a.triangularView<Eigen::Lower>();
  for (Index k = 0; k < n; ++k) {
    const double pivot = l(k, k);
    if (!(pivot > 0) || !std::isfinite(pivot)) not_positive_definite();
    l.col(k) /= std::sqrt(pivot);
    for (Index j = k + 1; j < n; ++j) l.col(j) -= l(j, k) * l.col(k);
    // Row k of L W^T = I.
    w(k, k) = 1;
    for (Index j = 0; j < k; ++j) w.col(k) -= l(k, j) * w.col(j);
    w.col(k) /= l(k, k);
  }
  for (Index j = 0; j < n; ++j) {
    Eigen::Matrix<double, kLeaf, 1> column = Eigen::Matrix<double, kLeaf, 1>::Zero();
    for (Index k = j; k < n; ++k) column += w(j, k) * w.col(k);
    a.col(j).tail(n - j) = column.segment(j, n - j);
  }
}

void copy_lower_to_upper(MatrixXd& a) {
  constexpr Index kTile = 8;  // the two tiles of a pair stay in L1
  const Index n = a.rows(), whole = n - n % kTile;
  for (Index j = 0; j < whole; j += kTile) {
    a.block<kTile, kTile>(j, j).triangularView<Eigen::StrictlyUpper>() =
        a.block<kTile, kTile>(j, j).transpose().eval();
    for (Index i = j + kTile; i < whole; i += kTile)
      a.block<kTile, kTile>(j, i) = a.block<kTile, kTile>(i, j).transpose();
  }
  const Index rest = n - whole;
  a.topRightCorner(whole, rest) = a.bottomLeftCorner(rest, whole).transpose();
  a.bottomRightCorner(rest, rest).triangularView<Eigen::StrictlyUpper>() =
      a.bottomRightCorner(rest, rest).transpose().eval();
}

// product = sign x E^T; only what lies on or below the 2x2 blocks of the diagonal where `lower_only`, and the
// rest of `product` is left alone.
void times_transposed(const MatrixXd& x, double sign, const LineCoupling& e, bool lower_only,
                      MatrixXd& product) {
  const Index size = x.cols();
  for (Index column = 0; column < size; ++column) {
    const Index node = column - column % 2, top = lower_only ? node : 0, rows = x.rows() - top;
    const auto at = [&](Index k) { return x.col(node - 2 + k).tail(rows); };
    const Eigen::Matrix<double, 1, 6> w = sign * e.band.row(column);
    auto out = product.col(column).tail(rows);
    if (node >= 2 && node + 4 <= size) {  // in one pass over memory
      out = w[0] * at(0) + w[1] * at(1) + w[2] * at(2) + w[3] * at(3) + w[4] * at(4) + w[5] * at(5);
      continue;
    }
    out.setZero();  // the outermost nodes have a neighbour on one side
    for (Index k = 0; k < 6; ++k)
      if (node - 2 + k >= 0 && node - 2 + k < size) out += w[k] * at(k);
  }
}

// Matrices as large as a line's, kept from line to line: fresh ones cost as much in page faults as the work.
struct Workspace {
  explicit Workspace(Index size) : a(size, size), b(size, size) {}
  MatrixXd a, b;
};

// change = -E neighbour^-1 E^T, its lower triangle; destroys `neighbour`, of which the lower triangle is
// read.
void eliminate(MatrixXd& neighbour, const LineCoupling& e, Workspace& w, MatrixXd& change) {
  invert_symmetric(neighbour);
  copy_lower_to_upper(neighbour);
  times_transposed(neighbour, 1, e, false, w.a);  // X E^T
  w.b = w.a.transpose();                          // E X, X symmetric
  times_transposed(w.b, -1, e, true, change);
}

// Stiffness of the elements of one row: linear in the modulus, so that equal neighbours share their
// integration.
class RowOfElements {
 public:
  RowOfElements(const TissueGrid& grid, const Material& material, std::size_t row)
      : grid_(grid), material_(material), row_(row), height_m_(grid.y_m[row + 1] - grid.y_m[row]) {}
  Eigen::Matrix<double, 8, 8> stiffness(std::size_t i) {
    const double width_m = grid_.x_m[i + 1] - grid_.x_m[i];
    if (width_m != width_m_) {
      width_m_ = width_m;
      unit_ = element_stiffness(width_m, height_m_, 1, material_.poisson_ratio);
    }
    return material_.youngs_modulus_pa[grid_.element(i, row_)] * unit_;
  }

 private:
  const TissueGrid& grid_;
  const Material& material_;
  std::size_t row_;
  double height_m_, width_m_ = 0;  // of the last one asked for
  Eigen::Matrix<double, 8, 8> unit_;
};

}  // namespace

void invert_symmetric(Eigen::Ref<MatrixXd> a) {
  const Index n = a.rows();
  if (n <= kLeaf) return invert_small(a);
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
  add_own(line, block);
  return block;
}

void LayeredStiffness::add_own(std::size_t line, MatrixXd& block) const {
  const auto add_row = [&](std::size_t row, int local) {  // element row; its top (0) or bottom (2) nodes
    RowOfElements elements(grid_, material_, row);
    for (std::size_t i = 0; i + 1 < grid_.nx(); ++i) {
      const auto k = elements.stiffness(i);
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
}

LineCoupling LayeredStiffness::coupling_below(std::size_t line) const {
  LineCoupling e;
  e.band.setZero(size(), 6);
  RowOfElements elements(grid_, material_, line);
  for (std::size_t i = 0; i + 1 < grid_.nx(); ++i) {
    const auto k = elements.stiffness(i);
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

MatrixXd LayeredStiffness::eliminated_below(std::vector<MatrixXd>* kept) const {
  if (kept) kept->resize(last_line_ - first_line_ + 1);
  MatrixXd stiffness = own(last_line_), next = MatrixXd::Zero(size(), size());
  Workspace workspace(size());
  for (std::size_t j = last_line_; j-- > first_line_;) {
    if (kept) (*kept)[j + 1 - first_line_] = stiffness;
    eliminate(stiffness, coupling_below(j), workspace, next);
    add_own(j, next);
    stiffness.swap(next);
  }
  if (kept) kept->front() = stiffness;
  return stiffness;
}

std::vector<MatrixXd> LayeredStiffness::condensed_lines(std::vector<MatrixXd> below) const {
  std::vector<MatrixXd> lines = std::move(below);
  if (lines.empty()) eliminated_below(&lines);
  Workspace workspace(size());
  MatrixXd above = own(first_line_), change = MatrixXd::Zero(size(), size());  // A_j, from the top down
  for (std::size_t j = first_line_ + 1; j <= last_line_; ++j) {
    eliminate(above, coupling_below(j - 1).transposed(), workspace, change);
    lines[j - first_line_] += change;  // A_j - D_j
    add_own(j, change);
    above.swap(change);
  }
  return lines;
}

}  // namespace teletact::service
