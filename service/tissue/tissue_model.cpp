#include "service/tissue/tissue_model.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <mutex>
#include <stdexcept>
#include <string>
#include <utility>

#include "service/tissue/column_condensation.h"
#include "service/tissue/condensation.h"
#include "service/tissue/condensed_line.h"
#include "service/tissue/iterative_line.h"
#include "service/tissue/iterative_lines.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

// Interior lines that wide tissue condenses one by one: about then all of them line by line are as cheap.
constexpr std::size_t kLinesByColumns = 4;
// Devices without double: up to here float alone converges at any contrast tested on square elements.
constexpr double kFloatPoissonRatio = 0.495;
// Of a column in double: a compliance is off by the square of it.
constexpr double kColumnError = 1e-4;

// From a line's Schur complement over all free columns, its lower triangle.
MatrixXd compliance_of(MatrixXd stiffness, const FreeNodes& free, ColumnRange touchable) {
  invert_symmetric(stiffness);
  const Index begin = 2 * Index(touchable.first - free.first_column);
  const Index size = 2 * Index(touchable.last - touchable.first + 1);
  return stiffness.block(begin, begin, size, size);
}

ColumnRange touchable_columns(const TissueGrid& grid, const FreeNodes& free,
                              const TissueModelOptions& options) {
  ColumnRange range{free.first_column, free.last_column};
  const double begin = options.touch_begin_m, end = options.touch_end_m;
  if (begin == 0 && end == 0) return range;
  if (!std::isfinite(begin) || !std::isfinite(end) || begin > end) {
    throw std::invalid_argument(
        "options.touch_begin_m and touch_end_m must be finite and in order; both 0 keeps every column");
  }
  const double slack = 1e-9 * (grid.x_m.back() - grid.x_m.front());
  while (range.first <= range.last && grid.x_m[range.first] < begin - slack) ++range.first;
  while (range.last > range.first && grid.x_m[range.last] > end + slack) --range.last;
  if (range.first > range.last || grid.x_m[range.last] > end + slack) {
    throw std::invalid_argument("options.touch_begin_m ... touch_end_m, " + std::to_string(begin) + " to " +
                                std::to_string(end) + ", holds no free column of nodes; widen it");
  }
  return range;
}

}  // namespace

std::size_t position_among(std::size_t column, ColumnRange range) {
  if (column < range.first || column > range.last) {
    throw std::out_of_range("compliance: column " + std::to_string(column) +
                            " is outside the touchable ones, " + std::to_string(range.first) + " to " +
                            std::to_string(range.last));
  }
  return column - range.first;
}

struct TissueModel::Lines final : Reclaimable {
  Lines(const TissueGrid& grid, const Supports& supports)
      : free(free_nodes(grid, supports)), condensed(grid.ny()) {}

  // Of the interior lines that are kept, the one used longest ago that nobody holds.
  std::uint64_t last_use() const override { return kept_use; }
  bool give_back() override {
    const std::unique_lock lock(kept_mutex, std::try_to_lock);
    if (!lock) return false;
    const auto unheld =
        std::find_if(kept.rbegin(), kept.rend(), [](const auto& one) { return one.second.use_count() == 1; });
    if (unheld == kept.rend()) return false;
    forget(std::prev(unheld.base()));
    return true;
  }

  // Under kept_mutex.
  template <class At>
  void forget(At at) {
    const std::lock_guard sides_lock(sides_mutex);
    sides.erase(at->first);
    kept.erase(at);
  }

  struct Line {
    std::mutex making;
    std::weak_ptr<Compliance> condensed;
  };
  FreeNodes free;
  std::shared_ptr<Compliance> surface;  // null where it is fixed
  std::vector<Line> condensed;          // interior lines, by line
  std::mutex kept_mutex;
  std::vector<std::pair<std::size_t, std::shared_ptr<Compliance>>> kept;  // of them, the one used last first
  std::atomic<std::uint64_t> kept_use = 0;                                // of the last
  Charge charge;                                                          // of the model itself

  // Column by column.
  bool wide = false;                        // it is the cheaper way
  bool all_lines = false;                   // fit in what lines may take
  std::atomic<std::size_t> by_columns = 0;  // interior lines condensed so
  std::mutex sides_mutex;
  struct Sides {
    Charge charge;
    CondensedSides sides;
  };
  std::map<std::size_t, Sides> sides;  // by line, where the modulus will change

  // Line by line.
  Charge swept_charge;
  std::vector<MatrixXd> below;  // of the surface's elimination, where interior lines are foreseen
  std::once_flag swept;
  std::vector<MatrixXd> stiffness;  // Schur complement of every free line; consumed line by line

  std::shared_ptr<IterativeLines> iterative = std::make_shared<IterativeLines>();
};

TissueModel::TissueModel(TissueGrid grid, Material material, Supports supports, TissueModelOptions options,
                         const TissueModel* before)
    : grid_(std::move(grid)), material_(std::move(material)), supports_(supports), options_(options) {
  validate(grid_, material_);
  lines_ = std::make_shared<Lines>(grid_, supports_);
  if (!(options_.thickness_m > 0) || !std::isfinite(options_.thickness_m)) {
    throw std::invalid_argument("options.thickness_m is " + std::to_string(options_.thickness_m) +
                                "; give the out-of-plane contact width in metres, above 0");
  }
  touchable_ = teletact::service::touchable_columns(grid_, lines_->free, options_);
  const FreeNodes& free = lines_->free;
  const CondensationCost cost = condensation_cost(free, touchable_);
  lines_->wide = cost.by_columns < cost.by_lines;
  lines_->all_lines =
      free.lines() * 4 * free.columns() * free.columns() * sizeof(double) <= options_.most_line_bytes;
  const std::size_t nodes = grid_.nx() + grid_.ny(), each = sizeof(double);
  lines_->charge = options_.account.charge(Place::kHost, "models", (grid_.elements() + nodes) * each);
  if (free.first_line == 0) lines_->surface = condense(0, before);
  options_.account.add(Place::kHost, lines_);
  options_.account.add(Place::kHost, lines_->iterative);
}

TissueModel::~TissueModel() = default;

void TissueModel::check_free(std::size_t line) const {
  const FreeNodes& free = lines_->free;
  if (line >= free.first_line && line <= free.last_line) return;
  throw std::out_of_range("line " + std::to_string(line) +
                          " cannot be touched: it is fixed or absent; lines " +
                          std::to_string(free.first_line) + " to " + std::to_string(free.last_line) + " can");
}

std::shared_ptr<Compliance> TissueModel::condensed(std::size_t line, const TissueModel* before) const {
  check_free(line);
  if (line == 0) return lines_->surface;
  Lines::Line& interior = lines_->condensed[line];
  const std::lock_guard lock(interior.making);
  std::shared_ptr<Compliance> condensed = interior.condensed.lock();
  if (!condensed) interior.condensed = condensed = condense(line, before);
  keep(line, condensed);
  return condensed;
}

std::shared_ptr<Compliance> TissueModel::made(std::size_t line) const {
  check_free(line);
  if (line == 0) return lines_->surface;
  const std::lock_guard lock(lines_->kept_mutex);
  const auto found = std::find_if(lines_->kept.begin(), lines_->kept.end(),
                                  [line](const auto& kept) { return kept.first == line; });
  if (found == lines_->kept.end()) return nullptr;
  lines_->kept_use = use_stamp();
  return found->second;
}

std::size_t TissueModel::line_bytes() const {
  const std::size_t touched = touchable_.last - touchable_.first + 1;
  return 4 * touched * touched * sizeof(double);
}

double TissueModel::line_operations() const {
  const CondensationCost cost = condensation_cost(lines_->free, touchable_);
  return std::min(cost.by_lines, cost.by_columns);
}

// What a line's successor may take over (T4.2c).
std::size_t TissueModel::sides_bytes() const {
  const std::size_t touched = touchable_.last - touchable_.first + 1, lines = lines_->free.lines();
  return 32 * (touched * touched + 2 * touched * lines + 4 * lines * lines);
}

// What the elimination line by line passes through, of every line.
std::size_t TissueModel::swept_bytes() const {
  return 32 * lines_->free.columns() * lines_->free.columns() * lines_->free.lines();
}

// While a line is condensed: a few squares of the wider of the ways.
std::size_t TissueModel::working_bytes() const {
  const std::size_t touched = touchable_.last - touchable_.first + 1,
                    width = lines_->wide ? std::max(touched, lines_->free.lines()) : lines_->free.columns();
  return 3 * 4 * width * width * sizeof(double);
}

void TissueModel::keep(std::size_t line, const std::shared_ptr<Compliance>& condensed) const {
  const std::size_t bytes = line_bytes() + (options_.will_change ? sides_bytes() : 0);
  const std::size_t most = std::max<std::size_t>(1, options_.most_line_bytes / bytes);
  const std::lock_guard lock(lines_->kept_mutex);
  auto& kept = lines_->kept;
  std::erase_if(kept, [line](const auto& other) { return other.first == line; });
  kept.insert(kept.begin(), {line, condensed});
  lines_->kept_use = use_stamp();
  if (kept.size() > most) lines_->forget(std::prev(kept.end()));
}

bool TissueModel::by_columns(std::size_t line) const {
  if (line == 0) return lines_->wide;
  return !lines_->all_lines || (lines_->wide && lines_->by_columns++ < kLinesByColumns);
}

std::shared_ptr<Compliance> TissueModel::condense(std::size_t line, const TissueModel* before) const {
  Lines& lines = *lines_;
  const MemoryAccount& account = options_.account;
  Charge held = account.charge(Place::kHost, "lines", line_bytes());
  const Charge work = account.charge(Place::kHost, "condensing", working_bytes());
  MatrixXd stiffness;
  if (!by_columns(line)) {
    const LayeredStiffness layers(grid_, material_, supports_, Layers::kLines);
    const auto charge_sweep = [&] { return account.charge(Place::kHost, "lines", swept_bytes()); };
    if (line == 0) {
      if (options_.interior_lines) lines.swept_charge = charge_sweep();
      stiffness = eliminated_below(layers, options_.interior_lines ? &lines.below : nullptr);
    } else {
      try {
        std::call_once(lines.swept, [&] {
          if (lines.below.empty()) lines.swept_charge = charge_sweep();
          lines.stiffness = condensed_lines(layers, std::move(lines.below));
        });
        stiffness = std::move(lines.stiffness[line - lines.free.first_line]);  // used once, then freed
      } catch (const MemoryRefused&) {                                         // column by column takes less
      }
    }
  }
  MatrixXd compliance;
  const bool line_by_line = stiffness.size() > 0;
  if (line_by_line) {
    compliance = compliance_of(std::move(stiffness), lines.free, touchable_);
  } else {
    const LayeredStiffness columns(grid_, material_, supports_, Layers::kColumns);
    const TouchedNodes touched{Index(line - lines.free.first_line), touchable_};
    CondensedSides sides = condensed_sides(columns, touched, same_sides(line, before));
    compliance = joined(sides, touched);
    if (options_.will_change) {
      Charge kept = account.charge(Place::kHost, "lines", sides_bytes());
      const std::lock_guard lock(lines.sides_mutex);
      lines.sides[line] = {std::move(kept), std::move(sides)};
    }
  }
  const double rounding = condensation_rounding(material_, compliance.diagonal().maxCoeff(), !line_by_line);
  return std::make_shared<CondensedLine>(compliance, touchable_, rounding, std::move(held));
}

CondensedSides TissueModel::same_sides(std::size_t line, const TissueModel* before) const {
  if (!before || before->grid_.x_m != grid_.x_m || before->grid_.y_m != grid_.y_m ||
      before->supports_ != supports_ || before->material_.poisson_ratio != material_.poisson_ratio ||
      before->touchable_ != touchable_)
    return {};
  const std::lock_guard lock(before->lines_->sides_mutex);
  const auto found = before->lines_->sides.find(line);
  if (found == before->lines_->sides.end()) return {};
  return unchanged(found->second.sides, grid_, before->material_, material_);
}

std::shared_ptr<Compliance> TissueModel::iterative(std::size_t line,
                                                   const std::shared_ptr<Device>& device) const {
  check_free(line);
  return lines_->iterative->at(
      line, device, options_.account,
      [&] {
        return std::make_shared<SharedSolver>(device, grid_, supports_, material_,
                                              iterative_options(*device, material_.poisson_ratio),
                                              options_.account);
      },
      [&](std::shared_ptr<SharedSolver> solver) {
        return std::make_shared<IterativeLine>(std::move(solver), grid_, material_.poisson_ratio, line,
                                               touchable_, options_.account);
      });
}

std::shared_ptr<Compliance> TissueModel::iterative(std::size_t line, const std::shared_ptr<Device>& device,
                                                   const ElasticitySolverOptions& options) const {
  check_free(line);
  auto solver =
      std::make_shared<SharedSolver>(device, grid_, supports_, material_, options, options_.account);
  auto made = std::make_shared<IterativeLine>(std::move(solver), grid_, material_.poisson_ratio, line,
                                              touchable_, options_.account);
  options_.account.add(Place::kHost, made);
  return made;
}

double TissueModel::modulus_near_pa(std::size_t column, std::size_t line) const {
  if (column >= grid_.nx() || line >= grid_.ny()) {
    throw std::out_of_range("modulus_near_pa: column or line outside the grid");
  }
  const std::size_t row = std::min(line, grid_.ny() - 2);
  const std::size_t left = column > 0 ? column - 1 : 0, right = std::min(column, grid_.nx() - 2);
  return (material_.youngs_modulus_pa[grid_.element(left, row)] +
          material_.youngs_modulus_pa[grid_.element(right, row)]) /
         2;
}

ElasticitySolverOptions iterative_options(const Device& device, double poisson_ratio) {
  ElasticitySolverOptions options;
  if (device.info().has_double) {
    options.precision = SolvePrecision::kDouble;
    options.relative_error = kColumnError;
  } else if (poisson_ratio <= kFloatPoissonRatio) {
    options.precision = SolvePrecision::kFloat;
  }
  return options;
}

void warm_iterative(const std::shared_ptr<Device>& device) {
  constexpr std::size_t kColumns = 120, kLines = 33;
  const TissueGrid grid{uniform_coordinates(0, 0.120, kColumns), uniform_coordinates(0, 0.040, kLines)};
  std::vector<double> poisson_ratios{0.49};
  if (!device->info().has_double) poisson_ratios.push_back(0.499);  // refined
  for (const double poisson_ratio : poisson_ratios) {
    const Material material{std::vector<double>(grid.elements(), 10e3), poisson_ratio};
    const TissueModel model(grid, material, {}, {});
    for (const std::size_t count : {1, 2}) {  // right-hand sides
      std::vector<std::size_t> nodes(count);
      for (std::size_t n = 0; n < count; ++n) nodes[n] = kColumns / 2 + 2 * n + count;
      model.iterative(0, device)->axial_among(nodes, nullptr);
    }
  }
}

}  // namespace teletact::service
