#include "service/tissue/block_elimination.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "service/device/cancellation.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

constexpr Index kLooked = 256;  // of a size whose inverse takes a millisecond or more
constexpr Index kLeaf = 32;     // below it a sweep in registers and L1 is faster than splitting further

[[noreturn]] void not_positive_definite() {
  throw std::domain_error(
      "condensation: the tissue stiffness is not positive definite in double precision; check the supports "
      "and "
      "reduce the modulus contrast");
}

// W = L^-T of a = L L^T, on a size known to the compiler (padded by zeros).
using Small = Eigen::Matrix<double, kLeaf, kLeaf>;
Small small_inverse_factor(const Eigen::Ref<const MatrixXd>& a) {
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
  return w;
}

// By W W^T. A Gauss-Jordan sweep loses a digit near nu = 1/2.
void invert_small(Eigen::Ref<MatrixXd> a) {
  const Index n = a.rows();
  const Small w = small_inverse_factor(a);
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

}  // namespace

void invert_symmetric(Eigen::Ref<MatrixXd> a) {
  const Index n = a.rows();
  if (n <= kLeaf) return invert_small(a);
  if (n >= kLooked) check_cancelled();
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

void invert_factor(Eigen::Ref<MatrixXd> a) {
  const Index n = a.rows();
  if (n <= kLeaf) {
    a = small_inverse_factor(a).topLeftCorner(n, n).transpose();
    return;
  }
  if (n >= kLooked) check_cancelled();
  const Index n1 = n / 2, n2 = n - n1;
  auto x = a.topLeftCorner(n1, n1);
  auto b = a.bottomLeftCorner(n2, n1);
  auto c = a.bottomRightCorner(n2, n2);
  invert_factor(x);
  const MatrixXd l = b * x.transpose();
  c.triangularView<Eigen::Lower>() -= l * l.transpose();
  invert_factor(c);
  const MatrixXd y = c * l;
  b.noalias() = -y * x;
  a.topRightCorner(n1, n2).setZero();
}

LayerCoupling LayerCoupling::transposed() const {
  const Index nodes = band.rows() / 2;
  LayerCoupling t;
  t.band.setZero(band.rows(), 6);
  for (Index i = 0; i < nodes; ++i) {
    for (Index neighbour = std::max<Index>(0, i - 1); neighbour <= std::min(nodes - 1, i + 1); ++neighbour) {
      t.band.block<2, 2>(2 * i, 2 * (neighbour - i + 1)) =
          band.block<2, 2>(2 * neighbour, 2 * (i - neighbour + 1)).transpose();
    }
  }
  return t;
}

void times_transposed(const MatrixXd& x, double sign, const LayerCoupling& e, Part part, MatrixXd& product) {
  const Index size = x.cols();
  for (Index column = 0; column < size; ++column) {
    const Index node = column - column % 2, top = part == Part::kLower ? node : 0, rows = x.rows() - top;
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

void eliminate(MatrixXd& neighbour, const LayerCoupling& e, LayerWorkspace& w, MatrixXd& change) {
  invert_symmetric(neighbour);
  copy_lower_to_upper(neighbour);
  times_transposed(neighbour, 1, e, Part::kWhole, w.a);  // X E^T
  w.b = w.a.transpose();                                 // E X, X symmetric
  times_transposed(w.b, -1, e, Part::kLower, change);
}

}  // namespace teletact::service
