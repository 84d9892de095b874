#include "service/tissue/condensation.h"

#include <algorithm>
#include <array>
#include <stdexcept>
#include <utility>

#include "service/device/cancellation.h"
#include "service/tissue/element.h"

namespace teletact::service {

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
