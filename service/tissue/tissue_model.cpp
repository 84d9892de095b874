#include "service/tissue/tissue_model.h"

#include <fmt/format.h>
#include <Eigen/Core>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <initializer_list>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <span>
#include <stdexcept>
#include <utility>
#include <vector>

#include "service/base/choices.h"
#include "service/base/memory.h"
#include "service/device/device.h"
#include "service/tissue/column_condensation.h"
#include "service/tissue/compliance.h"
#include "service/tissue/condensation.h"
#include "service/tissue/iterative_compliances.h"
#include "service/tissue/tissue_problem.h"

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

// The compliances of a problem's rows by condensation on the host, each by the cheaper way (T4.2, T4.2c).
// Wide tissue is eliminated column by column, which costs the same for each row. Deep tissue, and from the
// fifth interior row on any tissue whose rows all fit the bound of memory, is eliminated row by row: two
// sweeps once and one dense inverse for each row. The surface's is kept, of the interior rows (T4.4) those
// used last.
class CondensedCompliances final : public Reclaimable {
 public:
  // Condenses onto the surface, unless that is fixed. `before` (may be null): those of a problem of which
  // this one is a change; while they are there what is the same is taken over. Throws MemoryRefused.
  CondensedCompliances(std::shared_ptr<const TissueProblem> problem, const TissueModelOptions& options,
                       std::shared_ptr<const CondensedCompliances> before)
      : problem_(std::move(problem)),
        options_(options),
        before_(before),
        free_(free_nodes(problem_->grid, problem_->supports)),
        cost_(condensation_cost(free_, problem_->touchable)),
        rows_(problem_->grid.ny()) {
    if (free_.first_row == 0) surface_ = condense(0);
  }
  // That of the row, condensed if nobody holds it and it is not kept. Throws MemoryRefused.
  std::shared_ptr<Compliance> at(std::size_t row) {
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
  // That of the row if it is kept, else null.
  std::shared_ptr<Compliance> find(std::size_t row) {
    if (row == 0) return surface_;
    const std::lock_guard lock(mutex_);
    const auto found = std::ranges::find(kept_, row, [](const auto& one) { return one.first; });
    if (found == kept_.end()) return nullptr;
    used_ = use_stamp();
    return found->second;
  }
  // Gives back the interior row used longest ago that nobody holds.
  std::uint64_t last_use() const override { return used_; }
  bool give_back() override {
    const std::unique_lock lock(mutex_, std::try_to_lock);
    if (!lock) return false;
    const auto unheld = std::find_if(kept_.rbegin(), kept_.rend(),
                                     [](const auto& one) { return one.second.use_count() == 1; });
    if (unheld == kept_.rend()) return false;
    drop(std::prev(unheld.base()));
    return true;
  }

 private:
  using Kept = std::vector<std::pair<std::size_t, std::shared_ptr<Compliance>>>;
  struct Row {
    std::mutex making;
    std::weak_ptr<Compliance> made;
  };
  struct Sides {
    Charge charge;
    CondensedSides sides;
  };
  std::shared_ptr<Compliance> condense(std::size_t row) {
    const MemoryAccount& account = options_.account;
    Charge held = account.charge(Place::kHost, "compliances", compliance_bytes());
    const Charge work = account.charge(Place::kHost, "condensing", working_bytes());
    const ColumnRange touchable = problem_->touchable;
    MatrixXd stiffness = by_columns(row) ? MatrixXd() : swept(row), compliance;
    const bool row_by_row = stiffness.size() > 0;
    if (row_by_row) {
      compliance = compliance_of(std::move(stiffness), free_, touchable);
    } else {
      const LayeredStiffness columns(problem_->grid, problem_->material, problem_->supports,
                                     Layers::kColumns);
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
  bool by_columns(std::size_t row) {
    const bool all_rows = free_.rows() * 4 * free_.columns() * free_.columns() * sizeof(double) <=
                          options_.max_compliance_bytes;
    if (row == 0) return cost_.columns_are_cheaper();
    return !all_rows || (cost_.columns_are_cheaper() && by_columns_++ < choices::kRowsByColumns);
  }
  // Of a row.
  std::size_t compliance_bytes() const {
    return 4 * problem_->touchable.size() * problem_->touchable.size() * sizeof(double);
  }
  // What a row's successor may take over (T4.2c).
  std::size_t sides_bytes() const {
    const std::size_t t = problem_->touchable.size(), rows = free_.rows();
    return options_.will_change ? 32 * (t * t + 2 * t * rows + 4 * rows * rows) : 0;
  }
  // What the elimination row by row passes through, of every row.
  std::size_t swept_bytes() const { return 32 * free_.columns() * free_.columns() * free_.rows(); }
  // While a row is condensed: a few squares of the wider of the ways.
  std::size_t working_bytes() const {
    const std::size_t width =
        cost_.columns_are_cheaper() ? std::max(problem_->touchable.size(), free_.rows()) : free_.columns();
    return 3 * 4 * width * width * sizeof(double);
  }
  // The row's Schur complement, row by row; empty where there is no room for that: column by column takes
  // less.
  MatrixXd swept(std::size_t row) {
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
  // What was condensed before for the row and holds for this problem, too.
  CondensedSides same_sides(std::size_t row) const {
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
  // What was kept for the row's successor is not needed any more, either.
  void drop(Kept::iterator at) {
    sides_.erase(at->first);
    kept_.erase(at);
  }

  const std::shared_ptr<const TissueProblem> problem_;
  const TissueModelOptions options_;
  const std::weak_ptr<const CondensedCompliances> before_;
  const FreeNodes free_;
  const CondensationCost cost_;
  std::vector<Row> rows_;
  std::shared_ptr<Compliance> surface_;  // null where it is fixed
  std::atomic<std::uint64_t> used_ = 0;
  mutable std::mutex mutex_;            // of the next two
  Kept kept_;                           // of interior rows, the one used last first
  std::map<std::size_t, Sides> sides_;  // by row, column by column, where the modulus will change

  std::atomic<std::size_t> by_columns_ = 0;  // interior rows condensed column by column

  // Row by row.
  Charge swept_charge_;
  std::vector<Eigen::MatrixXd> below_;  // of the surface's elimination, where interior rows are foreseen
  std::once_flag swept_;
  std::vector<Eigen::MatrixXd> stiffness_;  // Schur complement of every free row; consumed row by row
};

namespace {

std::size_t bytes_of(const TissueGrid& grid) {
  return (grid.elements() + grid.nx() + grid.ny()) * sizeof(double);
}

}  // namespace

TissueModel::TissueModel(TissueGrid grid, Material material, Supports supports,
                         const TissueModelOptions& options, const TissueModel* before)
    : problem_(std::make_shared<const TissueProblem>(
          make_problem(std::move(grid), std::move(material), supports, options))),
      charge_(options.account.charge(Place::kHost, "models", bytes_of(problem_->grid))),
      condensed_(
          std::make_shared<CondensedCompliances>(problem_, options, before ? before->condensed_ : nullptr)),
      iterative_(std::make_shared<IterativeCompliances>(problem_, options.account)) {
  options.account.add(Place::kHost, condensed_);
  options.account.add(Place::kHost, iterative_);
}

void TissueModel::check_free(std::size_t row) const {
  const FreeNodes free = free_nodes(problem_->grid, problem_->supports);
  if (row < free.first_row || row > free.last_row)
    throw std::out_of_range(fmt::format("row {} cannot be touched: it is fixed or absent; rows {} to {} can",
                                        row, free.first_row, free.last_row));
}

std::shared_ptr<Compliance> TissueModel::compliance(std::size_t row,
                                                    const std::shared_ptr<Device>& device) const {
  check_free(row);
  return device ? iterative_->at(row, device) : condensed_->at(row);
}

std::shared_ptr<Compliance> TissueModel::ready(std::size_t row, const std::shared_ptr<Device>& device) const {
  check_free(row);
  return device ? iterative_->find(row, device) : condensed_->find(row);
}

void warm_iterative(const std::shared_ptr<Device>& device) {
  constexpr std::size_t kColumns = 120;
  std::vector<double> poisson_ratios{0.49};
  if (!device->info().has_double) poisson_ratios.push_back(0.499);  // refined
  for (const std::size_t rows : {33, 20})                           // by multigrid; narrow
    for (const double poisson_ratio : poisson_ratios) {
      const TissueGrid grid{uniform_coordinates(0, 0.120, kColumns),
                            uniform_coordinates(0, 0.0012 * double(rows), rows)};
      const Material material{std::vector<double>(grid.elements(), 10e3), poisson_ratio};
      const TissueModel model(grid, material, {}, {});
      for (const std::size_t count : {1, 2}) {  // right-hand sides
        std::vector<std::size_t> nodes(count);
        for (std::size_t n = 0; n < count; ++n) nodes[n] = kColumns / 2 + 2 * n + count;
        model.compliance(0, device)->axial_among(nodes, nullptr);
      }
    }
}

}  // namespace teletact::service
