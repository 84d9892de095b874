#include "service/tissue/line_condenser.h"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>

#include "service/plan/choices.h"
#include "service/tissue/condensation.h"
#include "service/tissue/condensed_line.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

// From a line's Schur complement over all free columns, its lower triangle.
MatrixXd compliance_of(MatrixXd stiffness, const FreeNodes& free, ColumnRange touchable) {
  invert_symmetric(stiffness);
  const Index begin = 2 * Index(touchable.first - free.first_column);
  const Index size = 2 * Index(touchable.last - touchable.first + 1);
  return stiffness.block(begin, begin, size, size);
}

}  // namespace

LineCondenser::LineCondenser(std::shared_ptr<const TissueProblem> problem, const CondenserOptions& options,
                             MemoryAccount account)
    : problem_(std::move(problem)),
      options_(options),
      account_(std::move(account)),
      free_(free_nodes(problem_->grid, problem_->supports)),
      cost_(condensation_cost(free_, problem_->touchable)) {}

void LineCondenser::check_free(std::size_t line) const {
  if (line >= free_.first_line && line <= free_.last_line) return;
  throw std::out_of_range(
      "line " + std::to_string(line) + " cannot be touched: it is fixed or absent; lines " +
      std::to_string(free_.first_line) + " to " + std::to_string(free_.last_line) + " can");
}

std::size_t LineCondenser::line_bytes() const {
  const std::size_t touched = problem_->touchable.last - problem_->touchable.first + 1;
  return 4 * touched * touched * sizeof(double);
}

double LineCondenser::operations() const {
  return std::min(cost_.by_lines, cost_.by_columns);
}

// What a line's successor may take over (T4.2c).
std::size_t LineCondenser::sides_bytes() const {
  const std::size_t touched = problem_->touchable.last - problem_->touchable.first + 1, lines = free_.lines();
  return options_.will_change ? 32 * (touched * touched + 2 * touched * lines + 4 * lines * lines) : 0;
}

// What the elimination line by line passes through, of every line.
std::size_t LineCondenser::swept_bytes() const {
  return 32 * free_.columns() * free_.columns() * free_.lines();
}

// While a line is condensed: a few squares of the wider of the ways.
std::size_t LineCondenser::working_bytes() const {
  const std::size_t touched = problem_->touchable.last - problem_->touchable.first + 1,
                    width = cost_.columns_are_cheaper() ? std::max(touched, free_.lines()) : free_.columns();
  return 3 * 4 * width * width * sizeof(double);
}

bool LineCondenser::by_columns(std::size_t line) {
  const bool all_lines =
      free_.lines() * 4 * free_.columns() * free_.columns() * sizeof(double) <= options_.most_line_bytes;
  if (line == 0) return cost_.columns_are_cheaper();
  return !all_lines || (cost_.columns_are_cheaper() && by_columns_++ < choices::kLinesByColumns);
}

// The line's Schur complement, line by line; empty where there is no room for that: column by column takes
// less.
MatrixXd LineCondenser::swept(std::size_t line) {
  const LayeredStiffness layers(problem_->grid, problem_->material, problem_->supports, Layers::kLines);
  const auto charge_sweep = [&] { return account_.charge(Place::kHost, "lines", swept_bytes()); };
  if (line == 0) {
    if (options_.interior_lines) swept_charge_ = charge_sweep();
    return eliminated_below(layers, options_.interior_lines ? &below_ : nullptr);
  }
  try {
    std::call_once(swept_, [&] {
      if (below_.empty()) swept_charge_ = charge_sweep();
      stiffness_ = condensed_lines(layers, std::move(below_));
    });
    return std::move(stiffness_[line - free_.first_line]);  // used once, then freed
  } catch (const MemoryRefused&) {
    return {};
  }
}

std::shared_ptr<Compliance> LineCondenser::condense(std::size_t line, const LineCondenser* before) {
  Charge held = account_.charge(Place::kHost, "lines", line_bytes());
  const Charge work = account_.charge(Place::kHost, "condensing", working_bytes());
  const ColumnRange touchable = problem_->touchable;
  MatrixXd stiffness = by_columns(line) ? MatrixXd() : swept(line), compliance;
  const bool line_by_line = stiffness.size() > 0;
  if (line_by_line) {
    compliance = compliance_of(std::move(stiffness), free_, touchable);
  } else {
    const LayeredStiffness columns(problem_->grid, problem_->material, problem_->supports, Layers::kColumns);
    const TouchedNodes touched{Index(line - free_.first_line), touchable};
    CondensedSides sides = condensed_sides(columns, touched, same_sides(line, before));
    compliance = joined(sides, touched);
    if (options_.will_change) {
      Charge kept = account_.charge(Place::kHost, "lines", sides_bytes());
      const std::lock_guard lock(sides_mutex_);
      sides_[line] = {std::move(kept), std::move(sides)};
    }
  }
  const double rounding =
      condensation_rounding(problem_->material, compliance.diagonal().maxCoeff(), !line_by_line);
  return std::make_shared<CondensedLine>(compliance, touchable, rounding, std::move(held));
}

void LineCondenser::forget(std::size_t line) {
  const std::lock_guard lock(sides_mutex_);
  sides_.erase(line);
}

// What `before` has for the line that holds for this problem too.
CondensedSides LineCondenser::same_sides(std::size_t line, const LineCondenser* before) const {
  if (!before) return {};
  const TissueProblem &was = *before->problem_, &now = *problem_;
  if (was.grid.x_m != now.grid.x_m || was.grid.y_m != now.grid.y_m || was.supports != now.supports ||
      was.material.poisson_ratio != now.material.poisson_ratio || was.touchable != now.touchable)
    return {};
  const std::lock_guard lock(before->sides_mutex_);
  const auto found = before->sides_.find(line);
  if (found == before->sides_.end()) return {};
  return unchanged(found->second.sides, now.grid, was.material, now.material);
}

}  // namespace teletact::service
