#include "service/tissue/iterative_compliances.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <stdexcept>
#include <string>

#include "service/base/choices.h"

namespace teletact::service {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;

constexpr std::size_t kRoundingSamples = std::size(kOtherUnits);  // each costs a product with K
constexpr std::size_t kStep = 2;  // columns of one step of prepare(): a batch is no cheaper
// Columns that are solved at once: a batch of the solver, fewer of a large grid. While they are solved each
// takes vectors of the grid: loads, u, r, M r, K M r and samples, and the solver's own.
constexpr std::size_t kBatch = 32, kMaxSolvingBytes = std::size_t{64} << 20;
constexpr std::size_t kSolvingBytes = 14 * sizeof(double), kColumnBytes = sizeof(double) + sizeof(float);

// Bound of the relative error that rounding leaves in a compliance: that of the residual K u, whose bulk part
// cancels. Measured (error_estimate_test): it grows about as the square root of bulk over shear.
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

// left^T S right over rows and columns `unknowns` - first of S.
Eigen::Vector2d forms_of(const Eigen::MatrixXf& s, Index first, std::span<const std::size_t> unknowns,
                         const Eigen::MatrixX2d& left, const Eigen::VectorXd& right) {
  Eigen::Vector2d forms = Eigen::Vector2d::Zero();
  for (Index b = 0; b < right.size(); ++b) {
    const float* column = s.col(Index(unknowns[std::size_t(b)]) - first).data();
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();
    for (Index a = 0; a < right.size(); ++a)
      sum += double(column[Index(unknowns[std::size_t(a)]) - first]) * left.row(a).transpose();
    forms += right[b] * sum;
  }
  return forms;
}

// When what it would give back next was used last.
std::uint64_t oldest_of(const std::shared_ptr<IterativeCompliance>& one) {
  return one.use_count() == 1 && one->empty() ? one->used() : one->last_use();
}

}  // namespace

// Columns that a call needs, which stay while it lives.
class IterativeCompliance::Asked {
 public:
  Asked(IterativeCompliance& of, std::span<const std::size_t> unknowns) : of_(of), unknowns_(unknowns) {
    const std::lock_guard lock(of_.mutex_);
    of_.used_ = use_stamp();
    for (const std::size_t unknown : unknowns_)
      ++of_.columns_[unknown].asked, of_.columns_[unknown].used = of_.used_;
  }
  ~Asked() {
    const std::lock_guard lock(of_.mutex_);
    for (const std::size_t unknown : unknowns_) --of_.columns_[unknown].asked;
  }
  Asked(const Asked&) = delete;
  Asked& operator=(const Asked&) = delete;

 private:
  IterativeCompliance& of_;
  const std::span<const std::size_t> unknowns_;
};

IterativeCompliance::IterativeCompliance(std::shared_ptr<SharedSolver> shared, const TissueProblem& problem,
                                         std::size_t row, const MemoryAccount& account)
    : shared_(std::move(shared)),
      account_(account),
      dofs_(problem.grid.dofs()),
      first_dof_(2 * problem.grid.node(problem.touchable.first, row)),
      touchable_(problem.touchable),
      rounding_bound_(rounding_error(problem.material.poisson_ratio)),
      columns_(2 * touchable_.size()) {
  const std::size_t pairs = columns_.size() * columns_.size();
  matrices_charge_ = account_.charge(Place::kHost, "compliances",
                                     pairs * (sizeof(double) + (2 + kRoundingSamples) * sizeof(float)));
  const auto size = Index(columns_.size());
  compliance_.setZero(size, size);
  unfinished_.setZero(size, size);
  step_energy_.setZero(size, size);
  rounding_.assign(kRoundingSamples, Eigen::MatrixXf::Zero(size, size));
}

MatrixXd IterativeCompliance::among(std::span<const std::size_t> nodes, SolveReport* report) {
  std::vector<std::size_t> unknowns;
  for (const std::size_t node : nodes) unknowns.insert(unknowns.end(), {axial(node) - 1, axial(node)});
  return between(unknowns, report);
}

MatrixXd IterativeCompliance::axial_among(std::span<const std::size_t> nodes, SolveReport* report) {
  std::vector<std::size_t> unknowns;
  for (const std::size_t node : nodes) unknowns.push_back(axial(node));
  return between(unknowns, report);
}

Eigen::VectorXd IterativeCompliance::axial_under(std::span<const std::size_t> at,
                                                 std::span<const std::size_t> loaded,
                                                 const Eigen::Matrix2Xd& force_n_m) {
  std::vector<std::size_t> unknowns;
  std::vector<double> force;
  for (std::size_t b = 0; b < loaded.size(); ++b)
    for (const Index component : {0, 1})
      if (const double f = force_n_m(component, Index(b)); f != 0) {
        unknowns.push_back(axial(loaded[b]) - 1 + std::size_t(component));
        force.push_back(f);
      }
  const Asked asked(*this, unknowns);
  get_ready(unknowns);
  const std::lock_guard lock(mutex_);
  Eigen::VectorXd moved = Eigen::VectorXd::Zero(Index(at.size()));
  for (std::size_t b = 0; b < unknowns.size(); ++b)
    for (std::size_t a = 0; a < at.size(); ++a)
      moved[Index(a)] += force[b] * columns_[unknowns[b]].displacement[Index(grid_dof(axial(at[a])))];
  return moved;
}

bool IterativeCompliance::prepare(std::span<const std::size_t> nodes, bool tangential,
                                  std::chrono::steady_clock::time_point until) {
  std::vector<std::size_t> unknowns;
  for (const std::size_t node : nodes) {
    unknowns.push_back(axial(node));
    if (tangential) unknowns.push_back(axial(node) - 1);
  }
  for (std::size_t begin = 0; begin < unknowns.size();) {
    const std::vector<std::size_t> step = next_missing(unknowns, begin, kStep);
    if (step.empty()) return true;
    if (std::chrono::steady_clock::now() >= until) return false;
    const Asked asked(*this, step);
    get_ready(step);
  }
  return true;
}

// The next of them from `begin` on that are not solved, so many at most; `begin` goes beyond them.
std::vector<std::size_t> IterativeCompliance::next_missing(const std::vector<std::size_t>& unknowns,
                                                           std::size_t& begin, std::size_t most) const {
  std::vector<std::size_t> missing;
  const std::lock_guard lock(mutex_);
  for (; begin < unknowns.size() && missing.size() < most; ++begin)
    if (!columns_[unknowns[begin]].solved) missing.push_back(unknowns[begin]);
  return missing;
}

MatrixXd IterativeCompliance::between(const std::vector<std::size_t>& unknowns, SolveReport* report) {
  const Asked asked(*this, unknowns);
  const std::size_t batch = std::clamp(kMaxSolvingBytes / (kSolvingBytes * dofs_), kStep, kBatch);
  for (std::size_t begin = 0; begin < unknowns.size();) get_ready(next_missing(unknowns, begin, batch));
  const std::lock_guard lock(mutex_);
  if (report) {
    *report = SolveReport{};
    for (std::size_t unknown : unknowns) merge(columns_[unknown].report, *report);
  }
  return compliance_(unknowns, unknowns);
}

std::uint64_t IterativeCompliance::last_use() const {
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (!lock) return UINT64_MAX;
  const auto oldest = oldest_unasked();
  return oldest == columns_.end() ? UINT64_MAX : oldest->used;
}

bool IterativeCompliance::give_back() {
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (!lock) return false;
  const auto oldest = oldest_unasked();
  if (oldest == columns_.end()) return false;
  columns_[static_cast<std::size_t>(oldest - columns_.begin())] = {};
  --solved_;
  return true;
}

std::vector<IterativeCompliance::Column>::const_iterator IterativeCompliance::oldest_unasked() const {
  auto oldest = columns_.end();
  for (auto at = columns_.begin(); at != columns_.end(); ++at)
    if (at->solved && at->asked == 0 && (oldest == columns_.end() || at->used < oldest->used)) oldest = at;
  return oldest;
}

std::optional<FormError> IterativeCompliance::error_between(std::span<const std::size_t> unknowns,
                                                            const Eigen::MatrixX2d& left,
                                                            const Eigen::VectorXd& right) const {
  const std::lock_guard lock(mutex_);
  const auto first = 2 * Index(touchable_.first);
  FormError error;
  double squares = 0;
  for (const Eigen::MatrixXf& sample : rounding_) {
    error.rounding.push_back(forms_of(sample, first, unknowns, left, right));
    double largest = 0;
    for (const std::size_t a : unknowns)
      for (const std::size_t b : unknowns) {
        const Index i = Index(a) - first, j = Index(b) - first;
        largest = std::max(largest,
                           std::abs(double(sample(i, j))) / std::sqrt(compliance_(i, i) * compliance_(j, j)));
      }
    squares += largest * largest;
  }
  error.largest_rounding = std::sqrt(squares / double(rounding_.size()));
  const auto unfinished = unfinished_between(unknowns, left, right);
  if (!unfinished) return {};
  error.unfinished = *unfinished;
  return error;
}

// |left^T R^T K^-1 R right| <= |R left| |R right| in the norm of K^-1. Of r = R left its square is estimated
// by one step of conjugate gradients, (r . M r)^2 / (M r . K M r), which is less than it. Empty where M shows
// that it is not positive definite: the columns' own bounds are then all there is.
std::optional<Eigen::Vector2d> IterativeCompliance::unfinished_between(std::span<const std::size_t> unknowns,
                                                                       const Eigen::MatrixX2d& left,
                                                                       const Eigen::VectorXd& right) const {
  std::vector<Index> at;
  for (const std::size_t unknown : unknowns) at.push_back(Index(unknown) - 2 * Index(touchable_.first));
  const MatrixXd step = unfinished_(at, at).cast<double>(), energy = step_energy_(at, at).cast<double>();
  const auto squared = [&](const Eigen::VectorXd& v) {
    const double along = v.dot(step * v), curvature = v.dot(energy * v);
    if (along == 0 && curvature == 0) return 0.0;  // nothing is left
    const double mean = curvature / along;
    if (!(along > 0 && mean > 0 && smallest_eigenvalue_ > 0)) return -1.0;
    return along / std::sqrt(mean * std::min(mean, smallest_eigenvalue_));
  };
  const double of_right = squared(right), of_first = squared(left.col(0)), of_second = squared(left.col(1));
  if (!(of_right >= 0 && of_first >= 0 && of_second >= 0)) return {};
  return Eigen::Vector2d(std::sqrt(of_right * of_first), std::sqrt(of_right * of_second));
}

// Of some columns.
struct IterativeCompliance::Solved {
  using Vectors = std::vector<double>;  // [column][dof]
  Solved(ElasticitySolver& solver, std::size_t count, Vectors loads)
      : dofs(loads.size() / count),
        displacement(loads.size()),
        report(solver.solve(count, loads, displacement)) {
    if (!std::isfinite(report.relative_error))
      throw std::runtime_error(
          std::string("conjugate gradients on the device: no usable solution (") + report.reason +
          "); its precision is not enough for this tissue or it is faulty, use the compliance");
    smallest_eigenvalue = solver.smallest_eigenvalue();
    const auto less = [&](Vectors force) {
      for (std::size_t n = 0; n < force.size(); ++n) force[n] = loads[n] - force[n];
      return force;
    };
    residual = less(solver.nodal_forces(count, displacement));
    preconditioned = solver.preconditioned(count, residual);
    step_force = solver.nodal_forces(count, preconditioned);
    for (const Units& units : kOtherUnits)
      rounding.push_back(less(solver.nodal_forces_in(units, count, displacement)));
  }
  Eigen::Map<const Eigen::VectorXd> column(const Vectors& v, std::size_t q) const {
    return {v.data() + q * dofs, Index(dofs)};
  }

  std::size_t dofs;
  Vectors displacement;  // u
  SolveReport report;
  double smallest_eigenvalue = 0;
  Vectors residual, preconditioned, step_force;  // r = f - K u; M r; K M r
  std::vector<Vectors> rounding;                 // what else r could have been
};

// Solves what is missing of `unknowns`, which are asked for, so that what is there stays.
void IterativeCompliance::get_ready(std::span<const std::size_t> unknowns) {
  // Room is made without the lock. Others may solve some of them meanwhile: their room is returned.
  std::vector<Charge> room;
  for (std::size_t k = 0; k < unknowns.size(); ++k)
    room.push_back(account_.charge(Place::kHost, "columns", kColumnBytes * dofs_));
  const Charge solving = account_.charge(Place::kHost, "solving", kSolvingBytes * dofs_ * unknowns.size());
  const std::lock_guard lock(mutex_);
  std::vector<std::size_t> missing;
  for (const std::size_t unknown : unknowns)
    if (!columns_[unknown].solved) missing.push_back(unknown);
  if (!missing.empty()) solve_columns(missing, room);
}

void IterativeCompliance::solve_columns(const std::vector<std::size_t>& missing, std::vector<Charge>& room) {
  std::vector<double> loads(missing.size() * dofs_);
  for (std::size_t q = 0; q < missing.size(); ++q) loads[q * dofs_ + grid_dof(missing[q])] = 1;
  Solved s = shared_->with(
      [&](ElasticitySolver& solver) { return Solved(solver, missing.size(), std::move(loads)); });
  smallest_eigenvalue_ = s.smallest_eigenvalue;
  // The product of two errors is left.
  s.report.relative_error = s.report.relative_error * s.report.relative_error + rounding_bound_;
  for (std::size_t q = 0; q < missing.size(); ++q) {
    Column& column = columns_[missing[q]];
    column.displacement = s.column(s.displacement, q);
    column.preconditioned = s.column(s.preconditioned, q).cast<float>();
    column.report = s.report;
    column.charge = std::move(room[q]);
    column.solved = true;
    ++solved_;
    add_to_compliance(missing[q], s, q);
  }
}

// Entries of `unknown`'s column, the q-th of those solved now, against every column solved so far, itself
// included. u and M r vanish where r is a support's reaction.
void IterativeCompliance::add_to_compliance(std::size_t unknown, const Solved& s, std::size_t q) {
  const auto set = [&](auto& matrix, std::size_t other, auto value) {
    matrix(Index(other), Index(unknown)) = matrix(Index(unknown), Index(other)) = value;
  };
  const auto residual = s.column(s.residual, q);
  const Eigen::VectorXf small_residual = residual.cast<float>();
  const Eigen::VectorXf small_force = s.column(s.step_force, q).cast<float>();
  for (std::size_t other = 0; other < columns_.size(); ++other) {
    const Column& column = columns_[other];
    if (!column.solved) continue;
    const double uncorrected = columns_[unknown].displacement[Index(grid_dof(other))];
    set(compliance_, other, uncorrected + column.displacement.dot(residual));
    set(unfinished_, other, column.preconditioned.dot(small_residual));
    set(step_energy_, other, column.preconditioned.dot(small_force));
    for (std::size_t k = 0; k < kRoundingSamples; ++k) {
      const double length = kOtherUnits[k].length, moved = length * uncorrected / length;
      const double again = moved + column.displacement.dot(s.column(s.rounding[k], q));
      set(rounding_[k], other, float(again - compliance_(Index(other), Index(unknown))));
    }
  }
}

ElasticitySolverOptions iterative_options(const Device& device, double poisson_ratio) {
  ElasticitySolverOptions options;
  if (device.info().has_double) {
    options.precision = SolvePrecision::kDouble;
    options.relative_error = choices::kColumnError;
  } else if (poisson_ratio <= choices::kFloatPoissonRatio) {
    options.precision = SolvePrecision::kFloat;
  }
  return options;
}

std::shared_ptr<Compliance> IterativeCompliances::find(std::size_t row,
                                                       const std::shared_ptr<Device>& device) const {
  const std::lock_guard lock(mutex_);
  const auto found = kept_.find({row, device});
  return found == kept_.end() ? nullptr : found->second;
}

std::shared_ptr<Compliance> IterativeCompliances::at(std::size_t row, const std::shared_ptr<Device>& device) {
  const std::lock_guard making(making_);
  if (auto kept = find(row, device)) return kept;
  // Without the other lock: to make one may take room, and compliances be given back for it.
  std::shared_ptr<SharedSolver> solver = solvers_[device];
  if (!solver) {
    ElasticitySolverOptions options = iterative_options(*device, problem_->material.poisson_ratio);
    options.account = account_;
    solver = std::make_shared<SharedSolver>(device, problem_, options);
    account_.add(device->place(), solver);
  }
  auto made = std::make_shared<IterativeCompliance>(solver, *problem_, row, account_);
  solvers_[device] = std::move(solver);
  const std::lock_guard lock(mutex_);
  kept_[{row, device}] = made;
  return made;
}

std::uint64_t IterativeCompliances::last_use() const {
  const std::unique_lock lock(mutex_, std::try_to_lock);
  std::uint64_t oldest = UINT64_MAX;
  if (lock)
    for (const auto& [key, one] : kept_) oldest = std::min(oldest, oldest_of(one));
  return oldest;
}

bool IterativeCompliances::give_back() {
  std::shared_ptr<IterativeCompliance> gone;  // destroyed without the lock
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (!lock || kept_.empty()) return false;
  const auto oldest = std::min_element(kept_.begin(), kept_.end(), [](const auto& a, const auto& b) {
    return oldest_of(a.second) < oldest_of(b.second);
  });
  if (oldest->second->give_back()) return true;
  if (oldest->second.use_count() > 1 || !oldest->second->empty()) return false;
  gone = std::move(oldest->second);
  kept_.erase(oldest);
  return true;
}

}  // namespace teletact::service
