#include "service/tissue/condensation.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "service/device/cancellation.h"
#include "service/tissue/element.h"

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

using Eigen::Index;
using Eigen::MatrixXd;

FreeNodes free_nodes(const TissueGrid& grid, const Supports& supports) {
  const auto fixed = [](EdgeSupport edge) { return edge == EdgeSupport::kFixed; };
  if (!fixed(supports.top) && !fixed(supports.bottom) && !fixed(supports.left) && !fixed(supports.right)) {
    throw std::invalid_argument(
        "supports: no edge is fixed, so the tissue would fly away when touched; fix at least one edge, for "
        "example the bottom");
  }
  FreeNodes free;
  free.first_row = fixed(supports.top) ? 1 : 0;
  free.first_column = fixed(supports.left) ? 1 : 0;
  const std::size_t end_row = grid.ny() - (fixed(supports.bottom) ? 1 : 0);
  const std::size_t end_column = grid.nx() - (fixed(supports.right) ? 1 : 0);
  if (end_row <= free.first_row || end_column <= free.first_column) {
    throw std::invalid_argument("supports: every node is fixed; leave an edge free or use a finer grid");
  }
  free.last_row = end_row - 1;
  free.last_column = end_column - 1;
  return free;
}

LayeredStiffness::LayeredStiffness(const TissueGrid& grid, const Material& material, const Supports& supports,
                                   Layers layers)
    : grid_(grid), material_(material), layers_(layers) {
  const FreeNodes free = free_nodes(grid, supports);
  first_layer_ = free.first_row, last_layer_ = free.last_row;
  first_node_ = free.first_column, last_node_ = free.last_column;
  if (layers == Layers::kColumns) {
    std::swap(first_layer_, first_node_);
    std::swap(last_layer_, last_node_);
  }
}

// Linear in the modulus, so that equal neighbours share their integration: of the first
// one's modulus, whose rounding other units change (T4.2b); that of 1 Pa they would not.
ElementLayer LayeredStiffness::elements_after(std::size_t layer) const {
  const bool by_rows = layers_ == Layers::kRows;
  const std::size_t count = (by_rows ? grid_.nx() : grid_.ny()) - 1;
  ElementLayer elements(first_node_, last_node_, count);
  double last_width_m = 0, last_height_m = 0;
  ElementLayer::Stiffness unit;
  const double unit_pa =
      material_.youngs_modulus_pa[by_rows ? grid_.element(0, layer) : grid_.element(layer, 0)];
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t i = by_rows ? k : layer, j = by_rows ? layer : k;
    const double width_m = grid_.x_m[i + 1] - grid_.x_m[i], height_m = grid_.y_m[j + 1] - grid_.y_m[j];
    if (width_m != last_width_m || height_m != last_height_m) {
      last_width_m = width_m, last_height_m = height_m;
      unit = element_stiffness(width_m, height_m, unit_pa, material_.poisson_ratio);
      constexpr std::array kAlongColumns{0, 1, 4, 5, 2, 3, 6, 7};
      if (!by_rows) unit = unit(kAlongColumns, kAlongColumns).eval();
    }
    elements.add(material_.youngs_modulus_pa[grid_.element(i, j)] / unit_pa * unit);
  }
  return elements;
}

void LayeredStiffness::add_own(std::size_t layer, MatrixXd& block) const {
  if (layer + 1 < layers()) elements_after(layer).add_own(ElementLayer::kBefore, block);
  if (layer > 0) elements_after(layer - 1).add_own(ElementLayer::kAfter, block);
}

std::size_t LayeredStiffness::layers() const {
  return layers_ == Layers::kRows ? grid_.ny() : grid_.nx();
}

MatrixXd LayeredStiffness::own(std::size_t layer) const {
  MatrixXd block = MatrixXd::Zero(size(), size());
  add_own(layer, block);
  return block;
}

ElementLayer::ElementLayer(std::size_t first_node, std::size_t last_node, std::size_t count)
    : first_node_(first_node), last_node_(last_node) {
  elements_.reserve(count);
}

template <class Add>
void ElementLayer::for_free_pairs(Add add) const {
  for (std::size_t k = 0; k < elements_.size(); ++k) {
    const bool is_free[2] = {k >= first_node_, k + 1 <= last_node_};
    const Index at = 2 * (Index(k) - Index(first_node_));
    for (int a = 0; a < 2; ++a)
      for (int b = 0; b < 2; ++b)
        if (is_free[a] && is_free[b]) add(elements_[k], at, a, b);
  }
}

void ElementLayer::add_own(Neighbour layer, MatrixXd& block) const {
  const int from = layer == kBefore ? 0 : 4;
  for_free_pairs([&](const Stiffness& e, Index at, int a, int b) {
    block.block<2, 2>(at + 2 * a, at + 2 * b) += e.block<2, 2>(from + 2 * a, from + 2 * b);
  });
}

LayerCoupling ElementLayer::coupling() const {
  LayerCoupling coupling;
  coupling.band.setZero(Index(2 * (last_node_ - first_node_ + 1)), 6);
  for_free_pairs([&](const Stiffness& e, Index at, int a, int b) {
    coupling.band.block<2, 2>(at + 2 * a, 2 * (b - a + 1)) += e.block<2, 2>(2 * a, 4 + 2 * b);
  });
  return coupling;
}

MatrixXd eliminated_below(const LayeredStiffness& rows, std::vector<MatrixXd>* kept) {
  const std::size_t first = rows.first_layer(), last = rows.last_layer();
  if (kept) kept->resize(last - first + 1);
  MatrixXd stiffness = rows.own(last), next = MatrixXd::Zero(rows.size(), rows.size());
  LayerWorkspace workspace(rows.size());
  for (std::size_t j = last; j-- > first;) {
    check_cancelled();
    if (kept) (*kept)[j + 1 - first] = stiffness;
    eliminate(stiffness, rows.elements_after(j).coupling(), workspace, next);
    rows.add_own(j, next);
    stiffness.swap(next);
  }
  if (kept) kept->front() = stiffness;
  return stiffness;
}

std::vector<MatrixXd> condensed_rows(const LayeredStiffness& rows, std::vector<MatrixXd> below) {
  std::vector<MatrixXd> condensed = std::move(below);
  if (condensed.empty()) eliminated_below(rows, &condensed);
  const std::size_t first = rows.first_layer();
  LayerWorkspace workspace(rows.size());
  // A_j, from the top down.
  MatrixXd above = rows.own(first), change = MatrixXd::Zero(rows.size(), rows.size());
  for (std::size_t j = first + 1; j <= rows.last_layer(); ++j) {
    check_cancelled();
    eliminate(above, rows.elements_after(j - 1).coupling().transposed(), workspace, change);
    condensed[j - first] += change;  // A_j - D_j
    rows.add_own(j, change);
    above.swap(change);
  }
  return condensed;
}

}  // namespace teletact::service
