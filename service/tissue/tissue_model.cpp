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
#include "service/tissue/form.h"
#include "service/tissue/iterative_line.h"
#include "service/tissue/units.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kRoundingSamples = 3;  // one for each background job
// Interior lines that wide tissue condenses one by one: about then all of them line by line are as cheap.
constexpr std::size_t kLinesByColumns = 4;
// Devices without double: up to here float alone converges at any contrast tested on square elements.
constexpr double kFloatPoissonRatio = 0.495;
// Of a column in double: a compliance is off by the square of it.
constexpr double kColumnError = 1e-4;

// Relative error that rounding leaves in an exact elimination: eps times a bound of the condition number
// (stiffest element against softest node), and what cancelling the bulk stiffness of nearly incompressible
// layers down to the shear that remains adds: measured errors follow (lambda / mu)^2 eps.
double rounding_error(const Material& material, double largest_compliance, std::size_t dofs) {
  const double nu = material.poisson_ratio, bulk_over_shear = 2 * nu / (1 - 2 * nu);
  const double modulus =
      *std::max_element(material.youngs_modulus_pa.begin(), material.youngs_modulus_pa.end());
  const double condition =
      modulus / (2 * (1 + nu)) * (2 + bulk_over_shear) * largest_compliance * double(dofs);
  return 16 * std::numeric_limits<double>::epsilon() * (condition + bulk_over_shear * bulk_over_shear);
}

class CondensedLine final : public Compliance {
 public:
  // `compliance`: of the touchable columns, its lower triangle.
  CondensedLine(const MatrixXd& compliance, ColumnRange touchable, const Material& material, std::size_t dofs)
      : columns_(touchable), compliance_(compliance.selfadjointView<Eigen::Lower>()) {
    if (!compliance_.allFinite()) throw std::domain_error("condensation: the compliance is not finite");
    bound_ = rounding_error(material, compliance_.diagonal().maxCoeff(), dofs);
  }

  MatrixXd among(std::span<const std::size_t> nodes, SolveReport* report) override {
    const Index n = Index(nodes.size());
    const std::vector<Index> at = positions(nodes);
    MatrixXd s(2 * n, 2 * n);
    for (Index b = 0; b < n; ++b) {
      for (Index a = 0; a < n; ++a) s.block<2, 2>(2 * a, 2 * b) = compliance_.block<2, 2>(at[a], at[b]);
    }
    state(report);
    return s;
  }

  MatrixXd axial_among(std::span<const std::size_t> nodes, SolveReport* report) override {
    const Index n = Index(nodes.size());
    const std::vector<Index> at = positions(nodes);
    MatrixXd s(n, n);
    for (Index b = 0; b < n; ++b) {
      for (Index a = 0; a < n; ++a) s(a, b) = compliance_(at[a] + 1, at[b] + 1);
    }
    state(report);
    return s;
  }

  std::optional<FormError> error_between(std::span<const std::size_t> unknowns, const Eigen::MatrixX2d& left,
                                         const VectorXd& right) const override {
    const std::shared_ptr<const Rounding> rounding = measured();
    if (!rounding || rounding->samples.size() < kRoundingSamples) return {};
    const Index first = 2 * Index(columns_.first);
    FormError error;
    error.largest_rounding = rounding->largest();
    for (const Eigen::MatrixXf& sample : rounding->samples)
      error.rounding.push_back(forms_of(sample, first, unknowns, left, right));
    return error;
  }

  const MatrixXd& whole() const { return compliance_; }
  std::size_t samples() const {
    const auto rounding = measured();
    return rounding ? rounding->samples.size() : 0;
  }
  // `other`: the whole compliance, computed with other rounding.
  void add_sample(const MatrixXd& other) {
    const auto before = measured();
    auto rounding = before ? std::make_shared<Rounding>(*before) : std::make_shared<Rounding>();
    const VectorXd root = compliance_.diagonal().cwiseSqrt();
    const MatrixXd difference = other - compliance_;
    const double largest = (difference.array() / (root * root.transpose()).array()).abs().maxCoeff();
    rounding->samples.push_back(difference.cast<float>());
    rounding->squares += largest * largest;
    const std::lock_guard lock(mutex_);
    rounding_ = std::move(rounding);
  }

 private:
  struct Rounding {
    std::vector<Eigen::MatrixXf> samples;  // size of the compliance
    double squares = 0;                    // of the largest relative entry of each
    double largest() const { return std::sqrt(squares / double(samples.size())); }
  };
  std::shared_ptr<const Rounding> measured() const {
    const std::lock_guard lock(mutex_);
    return rounding_;
  }
  std::vector<Index> positions(std::span<const std::size_t> nodes) const {
    std::vector<Index> at(nodes.size());
    for (std::size_t a = 0; a < nodes.size(); ++a) at[a] = 2 * Index(position_among(nodes[a], columns_));
    return at;
  }
  void state(SolveReport* report) const {
    if (!report) return;
    *report = SolveReport{};
    const auto rounding = measured();
    report->relative_error =
        rounding && rounding->samples.size() == kRoundingSamples ? rounding->largest() : bound_;
  }

  ColumnRange columns_;
  double bound_ = 0;
  mutable std::mutex mutex_;
  std::shared_ptr<const Rounding> rounding_;
  MatrixXd compliance_;
};

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

struct TissueModel::Lines {
  Lines(const TissueGrid& grid, const Supports& supports)
      : free(free_nodes(grid, supports)), condensed(grid.ny()) {}

  struct Line {
    std::mutex making;
    std::weak_ptr<Compliance> condensed;
  };
  FreeNodes free;
  std::shared_ptr<Compliance> surface;  // null where it is fixed
  std::vector<Line> condensed;          // interior lines, by line
  std::mutex kept_mutex;
  std::vector<std::pair<std::size_t, std::shared_ptr<Compliance>>> kept;  // of them, the one used last first

  // Column by column.
  bool wide = false;                        // it is the cheaper way
  bool all_lines = false;                   // fit in what lines may take
  std::atomic<std::size_t> by_columns = 0;  // interior lines condensed so
  std::mutex sides_mutex;
  std::map<std::size_t, CondensedSides> sides;  // by line, where the modulus will change

  // Line by line.
  std::vector<MatrixXd> below;  // of the surface's elimination, where interior lines are foreseen
  std::once_flag swept;
  std::vector<MatrixXd> stiffness;  // Schur complement of every free line; consumed line by line

  std::mutex measuring;  // one sample of rounding at a time

  std::mutex iterative_mutex;  // of the two maps
  std::map<std::shared_ptr<Device>, std::shared_ptr<SharedSolver>> solvers;
  std::map<std::pair<std::size_t, std::shared_ptr<Device>>, std::shared_ptr<Compliance>> iterative;
};

TissueModel::TissueModel(TissueGrid grid, Material material, Supports supports, TissueModelOptions options,
                         const TissueModel* before)
    : grid_(std::move(grid)), material_(std::move(material)), supports_(supports), options_(options) {
  validate(grid_, material_);
  lines_ = std::make_unique<Lines>(grid_, supports_);
  if (!(options_.thickness_m > 0) || !std::isfinite(options_.thickness_m)) {
    throw std::invalid_argument("options.thickness_m is " + std::to_string(options_.thickness_m) +
                                "; give the out-of-plane contact width in metres, above 0");
  }
  touchable_ = teletact::service::touchable_columns(grid_, lines_->free, options_);
  const FreeNodes& free = lines_->free;
  lines_->wide = columns_are_cheaper(free, touchable_);
  lines_->all_lines =
      free.lines() * 4 * free.columns() * free.columns() * sizeof(double) <= options_.most_line_bytes;
  if (free.first_line == 0) lines_->surface = condense(0, before);
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
  return found == lines_->kept.end() ? nullptr : found->second;
}

// A line with what its successor may take over: compliance, 20 freedoms^2 bytes, and sides (T4.2c).
void TissueModel::keep(std::size_t line, const std::shared_ptr<Compliance>& condensed) const {
  const std::size_t touched = touchable_.last - touchable_.first + 1, lines = lines_->free.lines();
  std::size_t bytes = 20 * 4 * touched * touched;
  if (options_.will_change) bytes += 32 * (touched * touched + 2 * touched * lines + 4 * lines * lines);
  const std::size_t most = std::max<std::size_t>(1, options_.most_line_bytes / bytes);
  const std::lock_guard lock(lines_->kept_mutex);
  auto& kept = lines_->kept;
  std::erase_if(kept, [line](const auto& other) { return other.first == line; });
  kept.insert(kept.begin(), {line, condensed});
  if (kept.size() <= most) return;
  const std::lock_guard sides_lock(lines_->sides_mutex);
  lines_->sides.erase(kept.back().first);
  kept.pop_back();
}

bool TissueModel::by_columns(std::size_t line) const {
  if (line == 0) return lines_->wide;
  return !lines_->all_lines || (lines_->wide && lines_->by_columns++ < kLinesByColumns);
}

std::shared_ptr<Compliance> TissueModel::condense(std::size_t line, const TissueModel* before) const {
  Lines& lines = *lines_;
  MatrixXd stiffness;
  if (!by_columns(line)) {
    const LayeredStiffness layers(grid_, material_, supports_, Layers::kLines);
    if (line == 0) {
      stiffness = eliminated_below(layers, options_.interior_lines ? &lines.below : nullptr);
    } else {
      std::call_once(lines.swept, [&] { lines.stiffness = condensed_lines(layers, std::move(lines.below)); });
      stiffness = std::move(lines.stiffness[line - lines.free.first_line]);  // used once, then freed
    }
  }
  MatrixXd compliance;
  if (stiffness.size() > 0) {
    compliance = compliance_of(std::move(stiffness), lines.free, touchable_);
  } else {
    const LayeredStiffness columns(grid_, material_, supports_, Layers::kColumns);
    const TouchedNodes touched{Index(line - lines.free.first_line), touchable_};
    CondensedSides sides = condensed_sides(columns, touched, same_sides(line, before));
    compliance = joined(sides, touched);
    const std::lock_guard lock(lines.sides_mutex);
    if (options_.will_change) lines.sides[line] = std::move(sides);
  }
  return std::make_shared<CondensedLine>(compliance, touchable_, material_, grid_.dofs());
}

CondensedSides TissueModel::same_sides(std::size_t line, const TissueModel* before) const {
  if (!before || before->grid_.x_m != grid_.x_m || before->grid_.y_m != grid_.y_m ||
      before->supports_ != supports_ || before->material_.poisson_ratio != material_.poisson_ratio ||
      before->touchable_ != touchable_)
    return {};
  const std::lock_guard lock(before->lines_->sides_mutex);
  const auto found = before->lines_->sides.find(line);
  if (found == before->lines_->sides.end()) return {};
  return unchanged(found->second, grid_, before->material_, material_);
}

std::shared_ptr<Compliance> TissueModel::iterative(std::size_t line,
                                                   const std::shared_ptr<Device>& device) const {
  check_free(line);
  const std::lock_guard lock(lines_->iterative_mutex);
  std::shared_ptr<SharedSolver>& solver = lines_->solvers[device];
  if (!solver)
    solver = std::make_shared<SharedSolver>(device, grid_, supports_, material_,
                                            iterative_options(*device, material_.poisson_ratio));
  std::shared_ptr<Compliance>& compliance = lines_->iterative[{line, device}];
  if (!compliance)
    compliance = std::make_shared<IterativeLine>(solver, grid_, material_.poisson_ratio, line, touchable_);
  return compliance;
}

std::shared_ptr<Compliance> TissueModel::iterative(std::size_t line, const std::shared_ptr<Device>& device,
                                                   const ElasticitySolverOptions& options) const {
  check_free(line);
  auto solver = std::make_shared<SharedSolver>(device, grid_, supports_, material_, options);
  return std::make_shared<IterativeLine>(std::move(solver), grid_, material_.poisson_ratio, line, touchable_);
}

// A compliance in plane strain depends on the moduli, and on ratios of lengths alone.
MatrixXd TissueModel::condensed_in_other_units(std::size_t line, const Units& units) const {
  TissueModelOptions options = options_;
  options.touch_begin_m *= units.length;
  options.touch_end_m *= units.length;
  const TissueModel other(in_units(grid_, units), in_units(material_, units), supports_, options);
  const std::shared_ptr<Compliance> held = other.condensed(line);
  return units.modulus * static_cast<const CondensedLine&>(*held).whole();
}

bool TissueModel::measure_rounding(std::size_t line) const {
  const std::shared_ptr<Compliance> held = condensed(line);  // others may make the model let go of it
  auto& measured = static_cast<CondensedLine&>(*held);
  const std::lock_guard lock(lines_->measuring);
  const std::size_t next = measured.samples();
  if (next == kRoundingSamples) return false;
  measured.add_sample(condensed_in_other_units(line, kOtherUnits[next]));
  return true;
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
