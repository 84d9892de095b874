#include "service/tissue/condenser.h"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>

#include "service/base/choices.h"
#include "service/tissue/condensation.h"
#include "service/tissue/condensed_compliance.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

// From a row's Schur complement over all free columns, its lower triangle.
MatrixXd compliance_of(MatrixXd stiffness, const FreeNodes& free, ColumnRange touchable) {
  invert_symmetric(stiffness);
  const Index begin = 2 * Index(touchable.first - free.first_column);
  const Index size = 2 * Index(touchable.last - touchable.first + 1);
  return stiffness.block(begin, begin, size, size);
}

}  // namespace

Condenser::Condenser(std::shared_ptr<const TissueProblem> problem, const CondenserOptions& options,
                     MemoryAccount account)
    : problem_(std::move(problem)),
      options_(options),
      account_(std::move(account)),
      free_(free_nodes(problem_->grid, problem_->supports)),
      cost_(condensation_cost(free_, problem_->touchable)) {}

void Condenser::check_free(std::size_t row) const {
  if (row >= free_.first_row && row <= free_.last_row) return;
  throw std::out_of_range("row " + std::to_string(row) + " cannot be touched: it is fixed or absent; rows " +
                          std::to_string(free_.first_row) + " to " + std::to_string(free_.last_row) + " can");
}

std::size_t Condenser::compliance_bytes() const {
  const std::size_t touched = problem_->touchable.last - problem_->touchable.first + 1;
  return 4 * touched * touched * sizeof(double);
}

double Condenser::operations() const {
  return std::min(cost_.by_rows, cost_.by_columns);
}

// What a row's successor may take over (T4.2c).
std::size_t Condenser::sides_bytes() const {
  const std::size_t touched = problem_->touchable.last - problem_->touchable.first + 1, rows = free_.rows();
  return options_.will_change ? 32 * (touched * touched + 2 * touched * rows + 4 * rows * rows) : 0;
}

// What the elimination row by row passes through, of every row.
std::size_t Condenser::swept_bytes() const {
  return 32 * free_.columns() * free_.columns() * free_.rows();
}

// While a row is condensed: a few squares of the wider of the ways.
std::size_t Condenser::working_bytes() const {
  const std::size_t touched = problem_->touchable.last - problem_->touchable.first + 1,
                    width = cost_.columns_are_cheaper() ? std::max(touched, free_.rows()) : free_.columns();
  return 3 * 4 * width * width * sizeof(double);
}

bool Condenser::by_columns(std::size_t row) {
  const bool all_rows =
      free_.rows() * 4 * free_.columns() * free_.columns() * sizeof(double) <= options_.max_compliance_bytes;
  if (row == 0) return cost_.columns_are_cheaper();
  return !all_rows || (cost_.columns_are_cheaper() && by_columns_++ < choices::kRowsByColumns);
}

// The row's Schur complement, row by row; empty where there is no room for that: column by column takes
// less.
MatrixXd Condenser::swept(std::size_t row) {
  const LayeredStiffness layers(problem_->grid, problem_->material, problem_->supports, Layers::kRows);
  const auto charge_sweep = [&] { return account_.charge(Place::kHost, "compliances", swept_bytes()); };
  if (row == 0) {
    if (options_.interior_layers) swept_charge_ = charge_sweep();
    return eliminated_below(layers, options_.interior_layers ? &below_ : nullptr);
  }
  try {
    std::call_once(swept_, [&] {
      if (below_.empty()) swept_charge_ = charge_sweep();
      stiffness_ = condensed_rows(layers, std::move(below_));
    });
    return std::move(stiffness_[row - free_.first_row]);  // used once, then freed
  } catch (const MemoryRefused&) {
    return {};
  }
}

std::shared_ptr<Compliance> Condenser::condense(std::size_t row, const Condenser* before) {
  Charge held = account_.charge(Place::kHost, "compliances", compliance_bytes());
  const Charge work = account_.charge(Place::kHost, "condensing", working_bytes());
  const ColumnRange touchable = problem_->touchable;
  MatrixXd stiffness = by_columns(row) ? MatrixXd() : swept(row), compliance;
  const bool row_by_row = stiffness.size() > 0;
  if (row_by_row) {
    compliance = compliance_of(std::move(stiffness), free_, touchable);
  } else {
    const LayeredStiffness columns(problem_->grid, problem_->material, problem_->supports, Layers::kColumns);
    const TouchedNodes touched{Index(row - free_.first_row), touchable};
    CondensedSides sides = condensed_sides(columns, touched, same_sides(row, before));
    compliance = joined(sides, touched);
    if (options_.will_change) {
      Charge kept = account_.charge(Place::kHost, "compliances", sides_bytes());
      const std::lock_guard lock(sides_mutex_);
      sides_[row] = {std::move(kept), std::move(sides)};
    }
  }
  const double rounding =
      condensation_rounding(problem_->material, compliance.diagonal().maxCoeff(), !row_by_row);
  return std::make_shared<CondensedCompliance>(compliance, touchable, rounding, std::move(held));
}

void Condenser::forget(std::size_t row) {
  const std::lock_guard lock(sides_mutex_);
  sides_.erase(row);
}

// What `before` has for the row that holds for this problem too.
CondensedSides Condenser::same_sides(std::size_t row, const Condenser* before) const {
  if (!before) return {};
  const TissueProblem &was = *before->problem_, &now = *problem_;
  if (was.grid.x_m != now.grid.x_m || was.grid.y_m != now.grid.y_m || was.supports != now.supports ||
      was.material.poisson_ratio != now.material.poisson_ratio || was.touchable != now.touchable)
    return {};
  const std::lock_guard lock(before->sides_mutex_);
  const auto found = before->sides_.find(row);
  if (found == before->sides_.end()) return {};
  return unchanged(found->second.sides, now.grid, was.material, now.material);
}

}  // namespace teletact::service
