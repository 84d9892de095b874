#include "service/tissue/column_condensation.h"

#include <algorithm>
#include <utility>

#include "service/device/cancellation.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

constexpr std::size_t kLeft = 0, kRight = 1;

// One side on its way from its end of the tissue inwards.
class Sweep {
 public:
  Sweep(const LayeredStiffness& columns, const TouchedNodes& touched, std::size_t side)
      : columns_(columns),
        touched_(touched),
        left_(side == kLeft),
        outer_(left_ ? ElementLayer::kBefore : ElementLayer::kAfter),
        inner_(left_ ? ElementLayer::kAfter : ElementLayer::kBefore),
        g_(columns.size(), columns.size()),
        next_(columns.size(), columns.size()) {}

  // The end of the tissue, and what holds it.
  CondensedSide begin() const {
    CondensedSide s;
    s.column = left_ ? columns_.first_layer() : columns_.last_layer();
    s.stiffness = MatrixXd::Zero(columns_.size(), columns_.size());
    s.following.resize(0, columns_.size());
    const bool held = left_ ? s.column > 0 : s.column + 1 < columns_.layers();
    if (held) columns_.elements_after(left_ ? s.column - 1 : s.column).add_own(inner_, s.stiffness);
    return s;
  }

  void advance(CondensedSide& s, std::size_t column) {
    while (s.column != column) {
      check_cancelled();
      const ElementLayer elements = columns_.elements_after(left_ ? s.column : s.column - 1);
      const LayerCoupling to_next = left_ ? elements.coupling().transposed() : elements.coupling();
      elements.add_own(outer_, s.stiffness);
      invert_factor(s.stiffness);
      times_transposed(s.stiffness, 1, to_next, Part::kWhole, g_);
      next_.setZero();
      next_.triangularView<Eigen::Lower>() -= g_.transpose() * g_;
      elements.add_own(inner_, next_);
      pass_touched(s, s.stiffness);
      s.stiffness.swap(next_);
      left_ ? ++s.column : --s.column;
    }
  }

 private:
  // Lets go of the column, `w` the inverse of its factor.
  void pass_touched(CondensedSide& s, const MatrixXd& w) {
    const Index before = s.following.rows(), at = 2 * touched_.position;
    const bool touched = s.column >= touched_.columns.first && s.column <= touched_.columns.last;
    const Index count = before + (touched ? 2 : 0);
    if (count == 0) return;
    z_.resize(count, w.cols());
    z_.topRows(before).noalias() = s.following * w.transpose();
    if (touched) {
      z_.bottomRows(2) = w.middleCols(at, 2).transpose();
      s.held.conservativeResizeLike(MatrixXd::Zero(count, count));
    }
    s.held.triangularView<Eigen::Lower>() += z_ * z_.transpose();
    s.following.noalias() = -z_ * g_;
  }

  const LayeredStiffness& columns_;
  const TouchedNodes& touched_;
  bool left_;
  ElementLayer::Neighbour outer_, inner_;  // the columns beside some elements, in their words
  MatrixXd z_, g_, next_;                  // Z, G and A'
};

std::size_t seam_of(const ColumnRange& touched) {
  return (touched.first + touched.last) / 2;
}

}  // namespace

CondensedSides unchanged(const CondensedSides& sides, const TissueGrid& grid, const Material& before,
                         const Material& now) {
  const auto same = [&](std::size_t i) {
    for (std::size_t j = 0; j + 1 < grid.ny(); ++j)
      if (before.youngs_modulus_pa[grid.element(i, j)] != now.youngs_modulus_pa[grid.element(i, j)])
        return false;
    return true;
  };
  // Columns of nodes up to which all elements from the end on are the same.
  std::size_t left = 0, right = grid.nx() - 1;
  while (left + 1 < grid.nx() && same(left)) ++left;
  while (right > 0 && same(right - 1)) --right;
  CondensedSides kept = sides;
  for (auto* states : {&kept.halfway, &kept.whole}) {
    auto& [from_left, from_right] = *states;
    if (from_left && from_left->column > left) from_left = nullptr;
    if (from_right && from_right->column < right) from_right = nullptr;
  }
  return kept;
}

CondensedSides condensed_sides(const LayeredStiffness& columns, const TouchedNodes& touched,
                               const CondensedSides& known) {
  CondensedSides sides = known;
  const std::size_t seam = seam_of(touched.columns);
  const std::array halfway{(columns.first_layer() + seam) / 2, (columns.last_layer() + seam + 1) / 2};
  for (const std::size_t side : {kLeft, kRight}) {
    if (sides.whole[side]) continue;
    Sweep sweep(columns, touched, side);
    if (!sides.halfway[side]) {
      CondensedSide s = sweep.begin();
      sweep.advance(s, halfway[side]);
      sides.halfway[side] = std::make_shared<const CondensedSide>(std::move(s));
    }
    CondensedSide s = *sides.halfway[side];
    sweep.advance(s, seam);
    sides.whole[side] = std::make_shared<const CondensedSide>(std::move(s));
  }
  return sides;
}

MatrixXd joined(const CondensedSides& sides, const TouchedNodes& touched) {
  const CondensedSide &left = *sides.whole[kLeft], &right = *sides.whole[kRight];
  MatrixXd w = left.stiffness + right.stiffness;
  invert_factor(w);
  const Index before = left.following.rows(), after = right.following.rows(), size = before + 2 + after;
  MatrixXd follow = MatrixXd::Zero(size, w.cols());
  follow.topRows(before) = left.following;
  follow.block<2, 2>(before, 2 * touched.position).setIdentity();
  // The right side's nodes come from the right.
  const auto turned = [&](Index k) { return k + size - 2 - 2 * (k - k % 2); };
  for (Index k = 0; k < after; ++k) follow.row(turned(k)) = right.following.row(k);
  MatrixXd compliance = MatrixXd::Zero(size, size);
  compliance.topLeftCorner(before, before).triangularView<Eigen::Lower>() = left.held;
  for (Index b = 0; b < after; ++b)
    for (Index a = b; a < after; ++a) {
      const auto [column, row] = std::minmax({turned(a), turned(b)});
      compliance(row, column) = right.held(a, b);
    }
  check_cancelled();
  const MatrixXd z = follow * w.transpose();
  check_cancelled();
  compliance.triangularView<Eigen::Lower>() += z * z.transpose();
  return compliance;
}

CondensationCost condensation_cost(const FreeNodes& free, const ColumnRange& touched) {
  const double rows = double(free.rows()), columns = double(free.columns());
  const double width = 2 * columns, depth = 2 * rows, nodes = double(touched.size());
  return {(rows + 1) * width * width * width, columns * depth * depth * depth +
                                                  depth * depth * nodes * nodes +
                                                  depth * nodes * nodes * (nodes / 3 + 4)};
}

}  // namespace teletact::service
