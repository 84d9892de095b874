#include "service/tissue/iterative_line.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

constexpr std::size_t kStep = 2;         // columns of one step of prepare(): a batch is no cheaper
constexpr double kFloatRounding = 6e-8;  // of u and r, which are kept in float

// Relative error that rounding leaves in a compliance: that of the residual K u, whose bulk part cancels.
// Measured (error_estimate_test): it grows about as the square root of bulk over shear.
double rounding_error(double poisson_ratio) {
  const double bulk_over_shear = 2 * poisson_ratio / (1 - 2 * poisson_ratio);
  return 2 * std::numeric_limits<double>::epsilon() * std::sqrt(1 + bulk_over_shear);
}

void merge(const SolveReport& one, SolveReport& worst) {
  worst.iterations = std::max(worst.iterations, one.iterations);
  worst.true_residual = std::max(worst.true_residual, one.true_residual);
  worst.recursive_residual = std::max(worst.recursive_residual, one.recursive_residual);
  worst.relative_error = std::max(worst.relative_error, one.relative_error);
  if (worst.converged) worst.reason = one.reason;
  worst.converged = worst.converged && one.converged;
}

}  // namespace

IterativeLine::IterativeLine(std::shared_ptr<SharedSolver> shared, const TissueGrid& grid,
                             double poisson_ratio, std::size_t line, ColumnRange touchable)
    : shared_(std::move(shared)),
      dofs_(grid.dofs()),
      first_dof_(2 * grid.node(touchable.first, line)),
      touchable_(touchable),
      rounding_(rounding_error(poisson_ratio)),
      columns_(2 * (touchable.last - touchable.first + 1)),
      compliance_(MatrixXd::Zero(Index(columns_.size()), Index(columns_.size()))) {}

MatrixXd IterativeLine::among(std::span<const std::size_t> nodes, SolveReport* report) {
  std::vector<std::size_t> unknowns;
  for (std::size_t node : nodes) {
    const std::size_t at = 2 * position_among(node, touchable_);
    unknowns.insert(unknowns.end(), {at, at + 1});
  }
  return between(unknowns, report);
}

MatrixXd IterativeLine::axial_among(std::span<const std::size_t> nodes, SolveReport* report) {
  std::vector<std::size_t> unknowns;
  for (std::size_t node : nodes) unknowns.push_back(2 * position_among(node, touchable_) + 1);
  return between(unknowns, report);
}

bool IterativeLine::prepare(std::span<const std::size_t> nodes, bool tangential,
                            std::chrono::steady_clock::time_point until) {
  std::vector<std::size_t> unknowns;
  for (const std::size_t node : nodes) {
    const std::size_t axial = 2 * position_among(node, touchable_) + 1;
    unknowns.push_back(axial);
    if (tangential) unknowns.push_back(axial - 1);
  }
  for (std::size_t begin = 0; begin < unknowns.size();) {
    const std::lock_guard lock(mutex_);
    std::vector<std::size_t> step;
    for (; begin < unknowns.size() && step.size() < kStep; ++begin)
      if (!columns_[unknowns[begin]].solved) step.push_back(unknowns[begin]);
    if (step.empty()) return true;
    if (std::chrono::steady_clock::now() >= until) return false;
    solve_missing(step);
  }
  return true;
}

MatrixXd IterativeLine::between(const std::vector<std::size_t>& unknowns, SolveReport* report) {
  const std::lock_guard lock(mutex_);
  solve_missing(unknowns);
  if (report) {
    *report = SolveReport{};
    for (std::size_t unknown : unknowns) merge(columns_[unknown].report, *report);
  }
  return compliance_(unknowns, unknowns);
}

void IterativeLine::solve_missing(const std::vector<std::size_t>& unknowns) {
  std::vector<std::size_t> missing;
  for (std::size_t unknown : unknowns) {
    if (!columns_[unknown].solved) missing.push_back(unknown);
  }
  if (missing.empty()) return;
  std::vector<double> loads(missing.size() * dofs_), displacement(loads.size());
  for (std::size_t q = 0; q < missing.size(); ++q) loads[q * dofs_ + grid_dof(missing[q])] = 1;
  SolveReport report;
  std::vector<double> force;
  {
    const std::lock_guard lock(shared_->mutex);
    report = shared_->solver.solve(missing.size(), loads, {}, displacement);
    force = shared_->solver.nodal_forces(missing.size(), displacement);
  }
  if (!std::isfinite(report.relative_error))
    throw std::runtime_error(std::string("conjugate gradients on the device: no usable solution (") +
                             report.reason + "); the device may be faulty, use the compliance");
  // The product of two errors is left, and what keeping u and r in float does to the correction by u . r.
  report.relative_error *= report.relative_error + kFloatRounding;
  report.relative_error += rounding_;
  for (std::size_t q = 0; q < missing.size(); ++q) {
    Column& column = columns_[missing[q]];
    column.report = report;
    column.displacement.resize(Index(dofs_));
    column.residual.resize(Index(dofs_));
    for (std::size_t n = 0; n < dofs_; ++n) {
      column.displacement[Index(n)] = float(displacement[q * dofs_ + n]);
      column.residual[Index(n)] = float(loads[q * dofs_ + n] - force[q * dofs_ + n]);
    }
    column.solved = true;
    add_to_compliance(missing[q], std::span(displacement).subspan(q * dofs_, dofs_));
  }
}

// Entries of `unknown`'s column against every column solved so far, itself included.
void IterativeLine::add_to_compliance(std::size_t unknown, std::span<const double> displacement) {
  const Column& column = columns_[unknown];
  for (std::size_t other = 0; other < columns_.size(); ++other) {
    if (!columns_[other].solved) continue;
    // u vanishes where r is a support's reaction.
    const double correction = columns_[other].displacement.cast<double>().dot(column.residual.cast<double>());
    compliance_(Index(other), Index(unknown)) = displacement[grid_dof(other)] + correction;
    compliance_(Index(unknown), Index(other)) = compliance_(Index(other), Index(unknown));
  }
}

}  // namespace teletact::service
