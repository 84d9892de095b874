// Outer loop: residuals in double, corrections by conjugate gradients in the working precision.
//
// Error of the answer, in the energy norm, from its true residual r:
//   ||K^-1 r||_K <= (r . M r / smallest eigenvalue of M K)^(1/2).
// Where that is more than was asked for, it may be less by another way: what conjugate gradients say is left,
// and the same bound of the gap between the true and the recursive residual, which is what their rounding
// added without their noticing. Neither holds where K or M is not positive definite.
#include "service/tissue/elasticity_solver.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>

#include "service/tissue/elasticity_correction.h"

namespace teletact::service {
namespace {

constexpr std::size_t kAtOnce = 32;      // right-hand sides solved at once
constexpr std::size_t kMaxPasses = 12;   // of refinement
constexpr double kPassReduction = 1e-4;  // of the error in one pass of refinement, within float's reach
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNegligibleEnergy = 1e-20;  // of the first guess's: a solution without strain

double norm(std::span<const double> v) {
  double sum = 0;
  for (const double x : v) sum += x * x;
  return std::sqrt(sum);
}

ScaledTissue in_units(ScaledTissue tissue, const Units& units) {
  for (double& e : tissue.material.youngs_modulus_pa) e *= units.modulus;
  return tissue;
}

bool finite(std::span<const double> v) {
  return std::all_of(v.begin(), v.end(), [](double x) { return std::isfinite(x); });
}

}  // namespace

// State of one right-hand side.
struct ElasticitySolver::Column {
  double load_norm = 0;  // of the load and of what the prescribed displacements act with
  double first_energy = 0;
  double energy = 0;         // u . K u, J/m
  double error = kInfinity;  // bound, energy norm
  double true_residual = 0, recursive_residual = 0;
  std::size_t iterations = 0;
  StopReason reason = StopReason::kRunning;
  double relative_error() const {
    const double norm = std::sqrt(std::max(energy, kNegligibleEnergy * first_energy));
    if (error == 0) return 0;
    return std::isfinite(error / norm) ? error / norm : kInfinity;
  }
};

ElasticitySolver::ElasticitySolver(const std::shared_ptr<Device>& device, TissueGrid grid,
                                   const Supports& supports, Material material,
                                   ElasticitySolverOptions options)
    : options_(std::move(options)), queue_(device->queue(options_.account)) {
  validate(grid, material);
  require(options_.relative_error >= 0 && std::isfinite(options_.relative_error),
          "relative_error must be 0 (default) or positive");
  require(options_.max_iterations > 0, "max_iterations must be at least 1");
  require(options_.prescribed.empty() || options_.prescribed.size() == grid.dofs(),
          "prescribed must have one entry per degree of freedom (" + std::to_string(grid.dofs()) + ")");
  if (options_.relative_error == 0)
    options_.relative_error = options_.precision == SolvePrecision::kFloat ? 6e-4 : 1e-7;
  if (options_.precision == SolvePrecision::kDouble && !queue_.supports(Precision::kDouble))
    throw DeviceError("device " + queue_.info().name + " has no double precision: choose refined");
  std::vector<std::uint8_t> free = free_unknowns(grid, supports);
  for (std::size_t n = 0; n < options_.prescribed.size(); ++n)
    if (options_.prescribed[n]) free[n] = 0;
  require(std::count(free.begin(), free.end(), 0) >= 3,
          "supports: nothing holds the tissue; fix an edge or prescribe displacements");
  const std::vector<double>& e = material.youngs_modulus_pa;
  const double mean_pa = std::accumulate(e.begin(), e.end(), 0.0) / static_cast<double>(e.size());
  tissue_ = {std::move(grid), std::move(material), mean_pa, std::move(free)};
  if (queue_.supports(Precision::kDouble)) exact_ = std::make_unique<Elasticity<double>>(queue_, tissue_);
}

ElasticitySolver::~ElasticitySolver() = default;

// All or nothing: what a device fails at is tried again at the next solve.
void ElasticitySolver::reserve(std::size_t count) {
  if (count <= capacity_) return;
  PcgOptions pcg;
  pcg.max_iterations = options_.max_iterations;
  const Precision inner =
      options_.precision == SolvePrecision::kDouble ? Precision::kDouble : Precision::kFloat;
  if (!correction_) correction_ = make_elasticity_correction(inner, queue_, tissue_, pcg);
  if (exact_) {
    exact_u_ = queue_.array<double>(count * dofs());
    exact_f_ = queue_.array<double>(count * dofs());
  }
  correction_->reserve(count);
  capacity_ = count;
}

// K u in double.
std::vector<double> ElasticitySolver::forces(Vectors u) {
  std::vector<double> force(u.size());
  if (!exact_) {
    apply_on_host(tissue_.grid, tissue_.material, u.size() / dofs(), u, force);
    return force;
  }
  queue_.send(exact_u_, u.data(), u.size());
  exact_->apply_unconstrained(exact_u_, exact_f_, u.size() / dofs());
  queue_.read(exact_f_, force.data(), force.size());
  for (double& f : force) f *= tissue_.reference_pa;
  return force;
}

std::vector<double> ElasticitySolver::forces_in(const Units& units, Vectors u) {
  std::vector<double> force(u.size()), other_u(u.begin(), u.end());
  for (double& value : other_u) value *= units.length;
  if (exact_) {
    std::unique_ptr<Elasticity<double>>& other = in_other_units_[units.modulus];
    if (!other) other = std::make_unique<Elasticity<double>>(queue_, in_units(tissue_, units), units.length);
    queue_.send(exact_u_, std::move(other_u));
    other->apply_unconstrained(exact_u_, exact_f_, u.size() / dofs());
    queue_.read(exact_f_, force.data(), force.size());
  } else {
    const ScaledTissue other = in_units(tissue_, units);
    apply_on_host(other.grid, other.material, u.size() / dofs(), other_u, force, units.length);
  }
  for (double& f : force) f *= (exact_ ? tissue_.reference_pa : 1) / (units.modulus * units.length);
  return force;
}

void ElasticitySolver::check(std::size_t count, Vectors loads, Vectors u) const {
  const std::string size = std::to_string(count * dofs()) + " entries (count x degrees of freedom)";
  require(loads.empty() || loads.size() == count * dofs(), "loads must have " + size);
  require(u.size() == count * dofs(), "displacement must have " + size);
  require(finite(loads), "loads hold a value that is not finite");
  require(finite(u), "displacement holds a value that is not finite");
}

// Vectors on the free unknowns, zero on the others.
std::vector<double> ElasticitySolver::masked(Vectors vectors) const {
  std::vector<double> masked(vectors.size());
  for (std::size_t begin = 0; begin < vectors.size(); begin += dofs())
    for (std::size_t dof = 0; dof < dofs(); ++dof)
      masked[begin + dof] = tissue_.free[dof] ? vectors[begin + dof] : 0;
  return masked;
}

// ||f - K u_held|| on the free unknowns, whatever the initial guess. force: K u.
std::vector<double> ElasticitySolver::right_hand_norms(const std::vector<double>& load, Vectors u,
                                                       const std::vector<double>& force) {
  std::vector<double> held = masked(u), right = load;
  const bool guessed = std::any_of(held.begin(), held.end(), [](double guess) { return guess != 0; });
  for (std::size_t n = 0; n < held.size(); ++n) held[n] = u[n] - held[n];
  const std::vector<double> of_held = guessed ? forces(held) : force;
  for (std::size_t n = 0; n < right.size(); ++n) right[n] -= of_held[n];
  right = masked(right);
  std::vector<double> norms;
  for (std::size_t q = 0; q < u.size() / dofs(); ++q) norms.push_back(norm(part(right, q, 1)));
  return norms;
}

// Residuals f - K u and energies u . K u of the present answer. force: K u.
void ElasticitySolver::refresh(Vectors load, Vectors u, const std::vector<double>& force,
                               std::vector<double>& residual, std::vector<Column>& columns) {
  for (std::size_t n = 0; n < residual.size(); ++n) residual[n] = load[n] - force[n];
  residual = masked(residual);
  for (std::size_t q = 0; q < columns.size(); ++q) {
    const Vectors a = part(u, q, 1), f = part(force, q, 1);
    columns[q].energy = std::inner_product(a.begin(), a.end(), f.begin(), 0.0);
    columns[q].true_residual = norm(part(residual, q, 1));
  }
}

// One run of conjugate gradients from the present answer, and what is then known of its error.
void ElasticitySolver::run(bool first, const std::vector<double>& load, std::span<double> u,
                           std::vector<double>& residual, std::vector<Column>& columns) {
  // Half of the error is left to rounding.
  const std::size_t count = columns.size();
  ElasticityCorrection::Problem problem{count, residual, load, {}, {}, options_.relative_error / 2};
  if (options_.precision == SolvePrecision::kRefined) {
    // Reduce the error itself; or stop at half of what is wanted, once the energy of the solution is known.
    problem.load = residual;
    problem.relative_error = std::max(kPassReduction, options_.relative_error);
    for (const Column& c : columns)
      problem.absolute_error.push_back(
          first ? 0 : options_.relative_error / 2 * std::sqrt(std::max(c.energy, 0.0)));
  } else {
    for (const Column& c : columns) problem.initial_energy.push_back(c.energy);
  }
  std::vector<double> x(residual.size());
  const std::vector<PcgResult> results = correction_->solve(problem, x);
  for (std::size_t n = 0; n < u.size(); ++n) u[n] += x[n];
  refresh(load, u, forces(u), residual, columns);
  for (const PcgResult& r : results)
    if (r.iterations > 0 && (smallest_eigenvalue_ == 0 || r.smallest_eigenvalue < smallest_eigenvalue_))
      smallest_eigenvalue_ = r.smallest_eigenvalue;
  const std::vector<double> bound = error_bounds(count, residual);
  bool enough = true;
  for (std::size_t q = 0; q < count; ++q) {
    columns[q].error = results[q].reason == StopReason::kIndefinite ? kInfinity : bound[q];
    columns[q].recursive_residual = results[q].recursive_residual;
    columns[q].iterations += results[q].iterations;
    columns[q].reason = results[q].reason;
    enough = enough && columns[q].relative_error() <= options_.relative_error;
  }
  if (enough) return;
  std::vector<double> gap(residual.size());
  correction_->recursive_residuals(gap);
  for (std::size_t n = 0; n < gap.size(); ++n) gap[n] = residual[n] - gap[n];
  const std::vector<double> rounding = error_bounds(count, gap);
  for (std::size_t q = 0; q < count; ++q)
    if (std::isfinite(columns[q].error))
      columns[q].error = std::min(columns[q].error, std::sqrt(results[q].squared_error) + rounding[q]);
}

// Of ||K^-1 r||_K, each.
std::vector<double> ElasticitySolver::error_bounds(std::size_t count, Vectors r) {
  std::vector<double> bounds = correction_->norm(count, r);
  for (double& bound : bounds) bound = bound == 0 ? 0 : bound / std::sqrt(smallest_eigenvalue_);
  return bounds;
}

std::vector<ElasticitySolver::Column> ElasticitySolver::solve_batch(std::size_t count, Vectors loads,
                                                                    std::span<double> u) {
  reserve(count);
  for (std::size_t begin = 0; begin < u.size(); begin += dofs())
    for (std::size_t dof = 0; dof < dofs(); ++dof)
      if (!tissue_.free[dof] && (options_.prescribed.empty() || !options_.prescribed[dof]))
        u[begin + dof] = 0;
  const std::vector<double> load = loads.empty() ? std::vector<double>(u.size()) : masked(loads);
  const bool moved = std::any_of(u.begin(), u.end(), [](double value) { return value != 0; });
  const std::vector<double> force = moved ? forces(u) : std::vector<double>(u.size());
  const std::vector<double> norms = right_hand_norms(load, u, force);
  std::vector<Column> columns(count);
  std::vector<double> residual(u.size());
  refresh(load, u, force, residual, columns);
  for (std::size_t q = 0; q < count; ++q) {
    columns[q].load_norm = norms[q];
    columns[q].first_energy = columns[q].energy;
  }
  double last = kInfinity;
  for (std::size_t pass = 0; pass < kMaxPasses; ++pass) {
    run(pass == 0, load, u, residual, columns);
    double worst = 0;
    bool sound = true;
    for (const Column& c : columns) {
      worst = std::max(worst, c.relative_error());
      sound = sound && c.reason == StopReason::kConverged;
    }
    // Done, beyond help, or no longer improving.
    if (worst <= options_.relative_error || !sound) break;
    if (!(worst < last / 2)) break;
    last = worst;
  }
  return columns;
}

SolveReport ElasticitySolver::report(const std::vector<Column>& columns) const {
  SolveReport report;
  StopReason worst = StopReason::kConverged;  // they get worse in their order
  report.reason = to_string(worst);
  for (const Column& c : columns) {
    const double scale = c.load_norm > 0 ? c.load_norm : 1;
    report.iterations = std::max(report.iterations, c.iterations);
    report.true_residual = std::max(report.true_residual, c.true_residual / scale);
    report.recursive_residual = std::max(report.recursive_residual, c.recursive_residual / scale);
    report.relative_error = std::max(report.relative_error, c.relative_error());
    if (c.reason != StopReason::kConverged) {
      report.converged = false;
      worst = std::max(worst, c.reason);
      report.reason = to_string(worst);
    } else if (!(c.relative_error() <= options_.relative_error) && report.converged) {
      report.converged = false;
      report.reason = "rounding of the working precision";
    }
  }
  return report;
}

SolveReport ElasticitySolver::solve(std::size_t count, Vectors loads, std::span<double> displacement) {
  check(count, loads, displacement);
  std::vector<Column> all;
  for (std::size_t begin = 0; begin < count; begin += kAtOnce) {
    const std::size_t batch = std::min(kAtOnce, count - begin);
    const auto columns =
        solve_batch(batch, part(loads, begin, batch), displacement.subspan(begin * dofs(), batch * dofs()));
    all.insert(all.end(), columns.begin(), columns.end());
  }
  return report(all);
}

std::vector<double> ElasticitySolver::in_batches(std::size_t count, Vectors vectors,
                                                 const std::function<std::vector<double>(Vectors)>& work) {
  check(count, {}, vectors);
  reserve(std::min(count, kAtOnce));
  std::vector<double> all;
  for (std::size_t begin = 0; begin < count; begin += kAtOnce) {
    const std::vector<double> made = work(part(vectors, begin, std::min(kAtOnce, count - begin)));
    all.insert(all.end(), made.begin(), made.end());
  }
  return all;
}

std::vector<double> ElasticitySolver::nodal_forces(std::size_t count, Vectors displacement) {
  return in_batches(count, displacement, [&](Vectors u) { return forces(u); });
}

std::vector<double> ElasticitySolver::nodal_forces_in(const Units& units, std::size_t count,
                                                      Vectors displacement) {
  return in_batches(count, displacement, [&](Vectors u) { return forces_in(units, u); });
}

std::vector<double> ElasticitySolver::preconditioned(std::size_t count, Vectors residual) {
  return in_batches(count, residual,
                    [&](Vectors r) { return correction_->preconditioned(r.size() / dofs(), masked(r)); });
}

}  // namespace teletact::service
