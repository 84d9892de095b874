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
#include <functional>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>

#include "service/tissue/elasticity_correction.h"
#include "service/tissue/units.h"

namespace teletact::service {
namespace {

constexpr std::size_t kAtOnce = 32;      // right-hand sides solved at once
constexpr std::size_t kMaxPasses = 12;  // of refinement
constexpr double kPassReduction = 1e-4;  // of the error in one pass of refinement, within float's reach
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNegligibleEnergy = 1e-20;  // of the first guess's: a solution without strain

// State of one right-hand side.
struct Column {
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

double norm(std::span<const double> v) {
  double sum = 0;
  for (const double x : v) sum += x * x;
  return std::sqrt(sum);
}

bool finite(std::span<const double> v) {
  return std::all_of(v.begin(), v.end(), [](double x) { return std::isfinite(x); });
}

}  // namespace

struct ElasticitySolver::Core {
  Core(const std::shared_ptr<Device>&, TissueGrid, const Supports&, ElasticitySolverOptions);
  void reserve(std::size_t count);
  std::vector<double> forces(std::size_t count, std::span<const double> displacement);
  std::vector<double> forces_in(const Units&, std::size_t count, std::span<const double> displacement);
  void check(std::size_t count, std::span<const double> loads, std::span<const double> prescribed,
             std::span<const double> displacement) const;
  std::vector<Column> solve(std::size_t count, std::span<const double> loads,
                            std::span<const double> prescribed, std::span<double> u);
  std::vector<double> masked(std::size_t count, std::span<const double> vectors) const;
  std::vector<double> right_hand_norms(std::size_t count, const std::vector<double>& load,
                                       std::span<const double> u, const std::vector<double>& force);
  void refresh(std::size_t count, std::span<const double> load, std::span<const double> u,
               const std::vector<double>& force, std::vector<double>& residual, std::vector<Column>& columns);
  void run(std::size_t count, bool first, const std::vector<double>& load, std::span<double> u,
           std::vector<double>& residual, std::vector<Column>& columns);
  std::vector<double> error_bounds(std::size_t count, std::span<const double> residual);
  SolveReport report(const std::vector<Column>&) const;
  // What `work` makes of vectors [count][dof], so many at a time as there is room for.
  using Work = std::function<std::vector<double>(std::size_t, std::span<const double>)>;
  std::vector<double> in_batches(std::size_t count, std::span<const double> vectors, const Work& work);
  std::span<const double> column(std::span<const double> v, std::size_t q) const {
    return v.subspan(q * grid.dofs(), grid.dofs());
  }

  TissueGrid grid;
  ElasticitySolverOptions options;
  Queue queue;
  std::vector<std::uint8_t> free;
  Material material;
  double reference_pa = 1;
  double smallest_eigenvalue = 0;  // of M K, the least seen with this material
  std::size_t capacity = 0;
  std::unique_ptr<Elasticity<double>> exact;  // none on a device without double
  Array<double> exact_u, exact_f;
  std::unique_ptr<ElasticityCorrection> correction;
};

ElasticitySolver::Core::Core(const std::shared_ptr<Device>& device, TissueGrid tissue,
                             const Supports& supports, ElasticitySolverOptions wanted)
    : grid(std::move(tissue)), options(std::move(wanted)), queue(device->queue(options.account)) {
  validate(grid);
  require(options.relative_error >= 0 && std::isfinite(options.relative_error),
          "relative_error must be 0 (default) or positive");
  require(options.max_iterations > 0, "max_iterations must be at least 1");
  require(options.prescribed.empty() || options.prescribed.size() == grid.dofs(),
          "prescribed must have one entry per degree of freedom (" + std::to_string(grid.dofs()) + ")");
  if (options.relative_error == 0)
    options.relative_error = options.precision == SolvePrecision::kFloat ? 6e-4 : 1e-7;
  if (options.precision == SolvePrecision::kDouble && !queue.supports(Precision::kDouble))
    throw DeviceError("device " + queue.info().name + " has no double precision: choose refined");
  free = free_unknowns(grid, supports);
  for (std::size_t n = 0; n < options.prescribed.size(); ++n)
    if (options.prescribed[n]) free[n] = 0;
  require(std::count(free.begin(), free.end(), 0) >= 3,
          "supports: nothing holds the tissue; fix an edge or prescribe displacements");
  if (queue.supports(Precision::kDouble)) exact = std::make_unique<Elasticity<double>>(queue, grid, free);
}

// All or nothing: what a device fails at is tried again at the next solve.
void ElasticitySolver::Core::reserve(std::size_t count) {
  if (count <= capacity) return;
  PcgOptions pcg;
  pcg.max_iterations = options.max_iterations;
  const Precision inner =
      options.precision == SolvePrecision::kDouble ? Precision::kDouble : Precision::kFloat;
  auto larger = make_elasticity_correction(inner, queue, grid, free, count, pcg);
  larger->set_material(material, reference_pa);
  if (exact) {
    exact_u = queue.array<double>(count * grid.dofs());
    exact_f = queue.array<double>(count * grid.dofs());
  }
  correction = std::move(larger);
  capacity = count;
}

// K u in double.
std::vector<double> ElasticitySolver::Core::forces(std::size_t count, std::span<const double> u) {
  const std::size_t size = count * grid.dofs();
  std::vector<double> force(size);
  if (!exact) {
    apply_on_host(grid, material, count, u, force);
    return force;
  }
  queue.send(exact_u, u.data(), size);
  exact->apply_unconstrained(exact_u, exact_f, count);
  queue.read(exact_f, force.data(), size);
  for (double& f : force) f *= reference_pa;
  return force;
}

std::vector<double> ElasticitySolver::Core::forces_in(const Units& units, std::size_t count,
                                                      std::span<const double> u) {
  std::vector<double> force(count * grid.dofs()), other_u(u.begin(), u.end());
  for (double& value : other_u) value *= units.length;
  if (exact) {
    Elasticity<double> other(queue, grid, free, units.length);
    other.set_material(in_units(material, units), reference_pa);
    queue.send(exact_u, other_u.data(), force.size());
    other.apply_unconstrained(exact_u, exact_f, count);
    queue.read(exact_f, force.data(), force.size());
  } else {
    apply_on_host(grid, in_units(material, units), count, other_u, force, units.length);
  }
  for (double& f : force) f *= (exact ? reference_pa : 1) / (units.modulus * units.length);
  return force;
}

void ElasticitySolver::Core::check(std::size_t count, std::span<const double> loads,
                                   std::span<const double> prescribed, std::span<const double> u) const {
  require(!material.youngs_modulus_pa.empty(), "set_material must come before a solve");
  const std::string size = std::to_string(count * grid.dofs()) + " entries (count x degrees of freedom)";
  require(loads.empty() || loads.size() == count * grid.dofs(), "loads must have " + size);
  require(prescribed.empty() || prescribed.size() == count * grid.dofs(), "prescribed must have " + size);
  require(u.size() == count * grid.dofs(), "displacement must have " + size);
  require(finite(loads), "loads hold a value that is not finite");
  require(finite(prescribed), "prescribed displacements hold a value that is not finite");
  require(finite(u), "displacement: the initial guess holds a value that is not finite");
}

// Vectors [count][dof] on the free unknowns, zero on the others; empty = none.
std::vector<double> ElasticitySolver::Core::masked(std::size_t count, std::span<const double> vectors) const {
  std::vector<double> masked(count * free.size(), 0.0);
  for (std::size_t begin = 0; begin < vectors.size(); begin += free.size())
    for (std::size_t dof = 0; dof < free.size(); ++dof)
      masked[begin + dof] = free[dof] ? vectors[begin + dof] : 0;
  return masked;
}

// ||f - K u_prescribed|| on the free unknowns, whatever the initial guess. force: K u.
std::vector<double> ElasticitySolver::Core::right_hand_norms(std::size_t count,
                                                             const std::vector<double>& load,
                                                             std::span<const double> u,
                                                             const std::vector<double>& force) {
  std::vector<double> held = masked(count, u), right = load;
  const bool guessed = std::any_of(held.begin(), held.end(), [](double guess) { return guess != 0; });
  for (std::size_t n = 0; n < held.size(); ++n) held[n] = u[n] - held[n];
  const std::vector<double> of_held = guessed ? forces(count, held) : force;
  for (std::size_t n = 0; n < right.size(); ++n) right[n] -= of_held[n];
  right = masked(count, right);
  std::vector<double> norms;
  for (std::size_t q = 0; q < count; ++q) norms.push_back(norm(column(right, q)));
  return norms;
}

// Residuals f - K u and energies u . K u of the present answer.
void ElasticitySolver::Core::refresh(std::size_t count, std::span<const double> load,
                                     std::span<const double> u, const std::vector<double>& force,
                                     std::vector<double>& residual, std::vector<Column>& columns) {
  for (std::size_t n = 0; n < residual.size(); ++n) residual[n] = load[n] - force[n];
  residual = masked(count, residual);
  for (std::size_t q = 0; q < count; ++q) {
    const auto a = column(u, q), f = column(force, q);
    columns[q].energy = std::inner_product(a.begin(), a.end(), f.begin(), 0.0);
    columns[q].true_residual = norm(column(residual, q));
  }
}

// One run of conjugate gradients from the present answer, and what is then known of its error.
void ElasticitySolver::Core::run(std::size_t count, bool first, const std::vector<double>& load,
                                 std::span<double> u, std::vector<double>& residual,
                                 std::vector<Column>& columns) {
  // Half of the error is left to rounding.
  ElasticityCorrection::Problem problem{count, residual, load, {}, {}, options.relative_error / 2};
  if (options.precision == SolvePrecision::kRefined) {
    // Reduce the error itself; or stop at half of what is wanted, once the energy of the solution is known.
    problem.load = residual;
    problem.relative_error = std::max(kPassReduction, options.relative_error);
    for (const Column& c : columns)
      problem.absolute_error.push_back(
          first ? 0 : options.relative_error / 2 * std::sqrt(std::max(c.energy, 0.0)));
  } else {
    for (const Column& c : columns) problem.initial_energy.push_back(c.energy);
  }
  std::vector<double> x(residual.size());
  const std::vector<PcgResult> results = correction->solve(problem, x);
  for (std::size_t n = 0; n < u.size(); ++n) u[n] += x[n];
  refresh(count, load, u, forces(count, u), residual, columns);
  for (const PcgResult& r : results)
    if (r.iterations > 0 && (smallest_eigenvalue == 0 || r.smallest_eigenvalue < smallest_eigenvalue))
      smallest_eigenvalue = r.smallest_eigenvalue;
  const std::vector<double> bound = error_bounds(count, residual);
  bool enough = true;
  for (std::size_t q = 0; q < count; ++q) {
    columns[q].error = results[q].reason == StopReason::kIndefinite ? kInfinity : bound[q];
    columns[q].recursive_residual = results[q].recursive_residual;
    columns[q].iterations += results[q].iterations;
    columns[q].reason = results[q].reason;
    enough = enough && columns[q].relative_error() <= options.relative_error;
  }
  if (enough) return;
  std::vector<double> gap(residual.size());
  correction->recursive_residuals(gap);
  for (std::size_t n = 0; n < gap.size(); ++n) gap[n] = residual[n] - gap[n];
  const std::vector<double> rounding = error_bounds(count, gap);
  for (std::size_t q = 0; q < count; ++q)
    if (std::isfinite(columns[q].error))
      columns[q].error = std::min(columns[q].error, std::sqrt(results[q].squared_error) + rounding[q]);
}

// Of ||K^-1 r||_K, each.
std::vector<double> ElasticitySolver::Core::error_bounds(std::size_t count, std::span<const double> r) {
  std::vector<double> bounds = correction->norm(count, r);
  for (double& bound : bounds) bound = bound == 0 ? 0 : bound / std::sqrt(smallest_eigenvalue);
  return bounds;
}

std::vector<Column> ElasticitySolver::Core::solve(std::size_t count, std::span<const double> loads,
                                                  std::span<const double> prescribed, std::span<double> u) {
  reserve(count);
  const bool any = !options.prescribed.empty() && !prescribed.empty();
  for (std::size_t begin = 0; begin < u.size(); begin += free.size())
    for (std::size_t dof = 0; dof < free.size(); ++dof)
      if (!free[dof]) u[begin + dof] = any && options.prescribed[dof] ? prescribed[begin + dof] : 0;
  const std::vector<double> load = masked(count, loads);
  const std::vector<double> force = forces(count, u), norms = right_hand_norms(count, load, u, force);
  std::vector<Column> columns(count);
  std::vector<double> residual(count * grid.dofs());
  refresh(count, load, u, force, residual, columns);
  for (std::size_t q = 0; q < count; ++q) {
    columns[q].load_norm = norms[q];
    columns[q].first_energy = columns[q].energy;
  }
  double last = kInfinity;
  for (std::size_t pass = 0; pass < kMaxPasses; ++pass) {
    run(count, pass == 0, load, u, residual, columns);
    double worst = 0;
    bool sound = true;
    for (const Column& c : columns) {
      worst = std::max(worst, c.relative_error());
      sound = sound && c.reason == StopReason::kConverged;
    }
    // Done, beyond help, or no longer improving.
    if (options.precision != SolvePrecision::kRefined || worst <= options.relative_error || !sound) break;
    if (!(worst < last / 2)) break;
    last = worst;
  }
  return columns;
}

std::vector<double> ElasticitySolver::Core::in_batches(std::size_t count, std::span<const double> vectors,
                                                       const Work& work) {
  check(count, {}, {}, vectors);
  reserve(std::min(count, kAtOnce));
  std::vector<double> all;
  for (std::size_t begin = 0; begin < count; begin += kAtOnce) {
    const std::size_t batch = std::min(kAtOnce, count - begin);
    const std::vector<double> part = work(batch, vectors.subspan(begin * grid.dofs(), batch * grid.dofs()));
    all.insert(all.end(), part.begin(), part.end());
  }
  return all;
}

SolveReport ElasticitySolver::Core::report(const std::vector<Column>& columns) const {
  SolveReport report;
  report.reason = to_string(StopReason::kConverged);
  for (const Column& c : columns) {
    const double scale = c.load_norm > 0 ? c.load_norm : 1;
    report.iterations = std::max(report.iterations, c.iterations);
    report.true_residual = std::max(report.true_residual, c.true_residual / scale);
    report.recursive_residual = std::max(report.recursive_residual, c.recursive_residual / scale);
    report.relative_error = std::max(report.relative_error, c.relative_error());
    if (c.reason != StopReason::kConverged) {
      report.converged = false;
      report.reason = to_string(c.reason);
    } else if (!(c.relative_error() <= options.relative_error) && report.converged) {
      report.converged = false;
      report.reason = "rounding of the working precision";
    }
  }
  return report;
}

ElasticitySolver::ElasticitySolver(const std::shared_ptr<Device>& device, TissueGrid grid, Supports supports,
                                   ElasticitySolverOptions options)
    : core_(std::make_unique<Core>(device, std::move(grid), supports, std::move(options))) {}

ElasticitySolver::~ElasticitySolver() = default;

void ElasticitySolver::set_material(const Material& material) {
  validate(core_->grid, material);
  const std::vector<double>& e = material.youngs_modulus_pa;
  core_->material = material;
  core_->reference_pa = std::accumulate(e.begin(), e.end(), 0.0) / static_cast<double>(e.size());
  core_->smallest_eigenvalue = 0;
  if (core_->exact) core_->exact->set_material(material, core_->reference_pa);
  if (core_->correction) core_->correction->set_material(material, core_->reference_pa);
}

const Queue& ElasticitySolver::queue() const {
  return core_->queue;
}

double ElasticitySolver::smallest_eigenvalue() const {
  return core_->smallest_eigenvalue;
}

const std::vector<std::uint8_t>& ElasticitySolver::free() const {
  return core_->free;
}

SolveReport ElasticitySolver::solve(std::size_t count, std::span<const double> loads,
                                    std::span<const double> prescribed, std::span<double> displacement) {
  core_->check(count, loads, prescribed, displacement);
  std::vector<Column> all;
  const std::size_t dofs = core_->grid.dofs();
  for (std::size_t begin = 0; begin < count; begin += kAtOnce) {
    const std::size_t batch = std::min(kAtOnce, count - begin);
    const auto part = [&](std::span<const double> v) {
      return v.empty() ? v : v.subspan(begin * dofs, batch * dofs);
    };
    const auto columns =
        core_->solve(batch, part(loads), part(prescribed), displacement.subspan(begin * dofs, batch * dofs));
    all.insert(all.end(), columns.begin(), columns.end());
  }
  return core_->report(all);
}

std::vector<double> ElasticitySolver::nodal_forces(std::size_t count, std::span<const double> displacement) {
  return core_->in_batches(count, displacement, [&](std::size_t batch, std::span<const double> part) {
    return core_->forces(batch, part);
  });
}

std::vector<double> ElasticitySolver::nodal_forces_in_units(std::size_t which, std::size_t count,
                                                            std::span<const double> displacement) {
  return core_->in_batches(count, displacement, [&](std::size_t batch, std::span<const double> part) {
    return core_->forces_in(kOtherUnits[which], batch, part);
  });
}

std::vector<double> ElasticitySolver::preconditioned(std::size_t count, std::span<const double> residual) {
  return core_->in_batches(count, residual, [&](std::size_t batch, std::span<const double> part) {
    return core_->correction->preconditioned(batch, core_->masked(batch, part));
  });
}

}  // namespace teletact::service
