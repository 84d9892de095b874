#include "service/tissue/condensed_compliances.h"

#include <algorithm>
#include <initializer_list>
#include <iterator>
#include <limits>
#include <span>
#include <stdexcept>

#include "service/base/choices.h"
#include "service/tissue/condensation.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

// Bound of the relative error |dC_ij| / sqrt(C_ii C_jj) that rounding leaves in any entry, calibrated once on
// measured rounding (rounding_test): it grows with bulk over shear, by rows of nodes with its square, with
// the stiffest element over the softest node, E C, and with the elements, most for a row amid deep tissue.
// Measured were at most 230 (1 + elements / 500) (1 + b) E C eps by columns, 210 + 0.8 b of it by rows,
// up to 29 000 elements.
double condensation_rounding(const Material& material, double largest_compliance, bool by_columns) {
  const double nu = material.poisson_ratio, bulk_over_shear = 2 * nu / (1 - 2 * nu);
  const double stiffest =
      *std::max_element(material.youngs_modulus_pa.begin(), material.youngs_modulus_pa.end());
  const double size = 1 + double(material.youngs_modulus_pa.size()) / 500;
  const double worst = size * (400 + (by_columns ? 0 : 1.5 * bulk_over_shear));
  return worst * (1 + bulk_over_shear) * stiffest * largest_compliance *
         std::numeric_limits<double>::epsilon();
}

class CondensedCompliance final : public Compliance {
 public:
  // `compliance`: of the touchable columns, its lower triangle. `rounding`: bound of its relative error.
  CondensedCompliance(const MatrixXd& compliance, ColumnRange touchable, double rounding, Charge held)
      : held_(std::move(held)),
        columns_(touchable),
        rounding_(rounding),
        compliance_(compliance.selfadjointView<Eigen::Lower>()) {
    if (!compliance_.allFinite()) throw std::domain_error("condensation: the compliance is not finite");
  }

  MatrixXd among(std::span<const std::size_t> nodes, SolveReport* report) override {
    return between(nodes, {0, 1}, report);
  }
  MatrixXd axial_among(std::span<const std::size_t> nodes, SolveReport* report) override {
    return between(nodes, {1}, report);
  }

 private:
  MatrixXd between(std::span<const std::size_t> nodes, std::initializer_list<Index> components,
                   SolveReport* report) const {
    std::vector<Index> unknowns;
    unknowns.reserve(2 * nodes.size());
    for (const std::size_t node : nodes)
      for (const Index c : components) unknowns.push_back(2 * Index(position_among(node, columns_)) + c);
    if (report) *report = {.relative_error = rounding_};
    return compliance_(unknowns, unknowns);
  }

  const Charge held_;
  const ColumnRange columns_;
  const double rounding_;
  const MatrixXd compliance_;
};

// From a row's Schur complement over all free columns, its lower triangle.
MatrixXd compliance_of(MatrixXd stiffness, const FreeNodes& free, ColumnRange touchable) {
  invert_symmetric(stiffness);
  const Index begin = 2 * Index(touchable.first - free.first_column);
  const Index size = 2 * Index(touchable.size());
  return stiffness.block(begin, begin, size, size);
}

}  // namespace

CondensedCompliances::CondensedCompliances(std::shared_ptr<const TissueProblem> problem,
                                           const TissueModelOptions& options,
                                           std::shared_ptr<const CondensedCompliances> before)
    : problem_(std::move(problem)),
      options_(options),
      before_(before),
      free_(free_nodes(problem_->grid, problem_->supports)),
      cost_(condensation_cost(free_, problem_->touchable)),
      rows_(problem_->grid.ny()) {
  if (free_.first_row == 0) surface_ = condense(0);
}

std::shared_ptr<Compliance> CondensedCompliances::at(std::size_t row) {
  if (row == 0) return surface_;
  const std::lock_guard making(rows_[row].making);
  std::shared_ptr<Compliance> made = rows_[row].made.lock();
  if (!made) rows_[row].made = made = condense(row);
  const std::lock_guard lock(mutex_);
  std::erase_if(kept_, [row](const auto& other) { return other.first == row; });
  kept_.insert(kept_.begin(), {row, made});
  used_ = use_stamp();
  const std::size_t max_kept = options_.max_compliance_bytes / (compliance_bytes() + sides_bytes());
  if (kept_.size() > std::max<std::size_t>(1, max_kept)) drop(std::prev(kept_.end()));
  return made;
}

std::shared_ptr<Compliance> CondensedCompliances::find(std::size_t row) {
  if (row == 0) return surface_;
  const std::lock_guard lock(mutex_);
  const auto found = std::ranges::find(kept_, row, [](const auto& one) { return one.first; });
  if (found == kept_.end()) return nullptr;
  used_ = use_stamp();
  return found->second;
}

// What was kept for the row's successor is not needed any more, either.
void CondensedCompliances::drop(Kept::iterator at) {
  sides_.erase(at->first);
  kept_.erase(at);
}

bool CondensedCompliances::give_back() {
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (!lock) return false;
  const auto unheld =
      std::find_if(kept_.rbegin(), kept_.rend(), [](const auto& one) { return one.second.use_count() == 1; });
  if (unheld == kept_.rend()) return false;
  drop(std::prev(unheld.base()));
  return true;
}

std::size_t CondensedCompliances::compliance_bytes() const {
  return 4 * problem_->touchable.size() * problem_->touchable.size() * sizeof(double);
}

// What a row's successor may take over (T4.2c).
std::size_t CondensedCompliances::sides_bytes() const {
  const std::size_t t = problem_->touchable.size(), rows = free_.rows();
  return options_.will_change ? 32 * (t * t + 2 * t * rows + 4 * rows * rows) : 0;
}

// What the elimination row by row passes through, of every row.
std::size_t CondensedCompliances::swept_bytes() const {
  return 32 * free_.columns() * free_.columns() * free_.rows();
}

// While a row is condensed: a few squares of the wider of the ways.
std::size_t CondensedCompliances::working_bytes() const {
  const std::size_t width =
      cost_.columns_are_cheaper() ? std::max(problem_->touchable.size(), free_.rows()) : free_.columns();
  return 3 * 4 * width * width * sizeof(double);
}

bool CondensedCompliances::by_columns(std::size_t row) {
  const bool all_rows =
      free_.rows() * 4 * free_.columns() * free_.columns() * sizeof(double) <= options_.max_compliance_bytes;
  if (row == 0) return cost_.columns_are_cheaper();
  return !all_rows || (cost_.columns_are_cheaper() && by_columns_++ < choices::kRowsByColumns);
}

// The row's Schur complement, row by row; empty where there is no room for that: column by column takes
// less.
MatrixXd CondensedCompliances::swept(std::size_t row) {
  const LayeredStiffness layers(problem_->grid, problem_->material, problem_->supports, Layers::kRows);
  const auto charge_sweep = [&] {
    return options_.account.charge(Place::kHost, "compliances", swept_bytes());
  };
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

std::shared_ptr<Compliance> CondensedCompliances::condense(std::size_t row) {
  const MemoryAccount& account = options_.account;
  Charge held = account.charge(Place::kHost, "compliances", compliance_bytes());
  const Charge work = account.charge(Place::kHost, "condensing", working_bytes());
  const ColumnRange touchable = problem_->touchable;
  MatrixXd stiffness = by_columns(row) ? MatrixXd() : swept(row), compliance;
  const bool row_by_row = stiffness.size() > 0;
  if (row_by_row) {
    compliance = compliance_of(std::move(stiffness), free_, touchable);
  } else {
    const LayeredStiffness columns(problem_->grid, problem_->material, problem_->supports, Layers::kColumns);
    const TouchedNodes touched{Index(row - free_.first_row), touchable};
    CondensedSides sides = condensed_sides(columns, touched, same_sides(row));
    compliance = joined(sides, touched);
    if (options_.will_change) {
      Charge kept = account.charge(Place::kHost, "compliances", sides_bytes());
      const std::lock_guard lock(mutex_);
      sides_[row] = {std::move(kept), std::move(sides)};
    }
  }
  const double rounding =
      condensation_rounding(problem_->material, compliance.diagonal().maxCoeff(), !row_by_row);
  return std::make_shared<CondensedCompliance>(compliance, touchable, rounding, std::move(held));
}

// What was condensed before for the row and holds for this problem, too.
CondensedSides CondensedCompliances::same_sides(std::size_t row) const {
  const auto before = before_.lock();
  if (!before) return {};
  const TissueProblem &was = *before->problem_, &now = *problem_;
  if (was.grid.x_m != now.grid.x_m || was.grid.y_m != now.grid.y_m || was.supports != now.supports ||
      was.material.poisson_ratio != now.material.poisson_ratio || was.touchable != now.touchable)
    return {};
  const std::lock_guard lock(before->mutex_);
  const auto found = before->sides_.find(row);
  if (found == before->sides_.end()) return {};
  return unchanged(found->second.sides, now.grid, was.material, now.material);
}

}  // namespace teletact::service
