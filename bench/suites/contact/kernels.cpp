// The kernels of the device's conjugate gradients against what the device can do (acceptance 8).
#include "bench/suites/contact/contact.h"
#include "service/solver/multigrid.h"
#include "service/tissue/elasticity_solver.h"

namespace teletact::bench {
namespace {

// Of one launch and right-hand side, from the kernels' comments: conjugate gradients in double, multigrid in
// float. A step of multigrid is a launch on each level that is not small: the mean of these; `run_steps` is
// all of them on the small levels. Each array counts once.
Works work_of(const service::TissueGrid& grid, const service::Queue& queue) {
  using service::CycleStep;
  const service::Multigrid<double, float> multigrid(queue, {grid.x_m, grid.y_m});
  const auto fine = static_cast<double>(grid.nodes());
  const auto per = [&](double reals, double flops) {
    return Work{fine * reals * sizeof(double), fine * flops};
  };
  constexpr double kPackBytes = 2 * (sizeof(double) + sizeof(float));
  const struct {
    CycleStep step;
    const char* kernel;
    double bytes, flops;  // of a node
  } steps[] = {{CycleStep::kResidual, "residual", 4 * (20 + 6), 90},
               {CycleStep::kSmooth, "smooth", 4 * (20 + 2 + 4 + 4), 96},
               {CycleStep::kSmoothFromZero, "smooth", 4 * (20 + 2 + 4), 92},
               {CycleStep::kRestrict, "restrict_residual", 4 * (2 + 0.25 * 20), 13},
               {CycleStep::kProlong, "prolong_add", 4 * (4 + 2 + 0.25 * 18), 12},
               {CycleStep::kPack, "vectors_to_planes", kPackBytes, 0},
               {CycleStep::kUnpack, "planes_to_vectors", kPackBytes, 0}};
  Works work{{"elasticity_apply", per(2 + 2 + 2 + 2, 240)},
             {"elasticity_stencil", per(36 + 2 + 1, 600)},
             {"dot_two", per(8, 8)},
             {"pcg_update", per(12, 12)},
             {"pcg_direction", per(6, 4)}};
  // The coarsest level is a dense product.
  const double solves = multigrid.small_nodes(CycleStep::kSolve),
               unknowns = 2 * static_cast<double>(multigrid.coarsest_nodes());
  Work& small = work["run_steps"];
  small = {solves * 2 * unknowns * sizeof(float), solves * 2 * unknowns * 2};
  for (const auto& s : steps) {
    const double nodes = multigrid.mean_nodes(s.step), in_one = multigrid.small_nodes(s.step);
    work.try_emplace(s.kernel, Work{nodes * s.bytes, nodes * s.flops});
    small.bytes += in_one * s.bytes;
    small.flops += in_one * s.flops;
  }
  return work;
}

}  // namespace

KernelProfile measure_kernels(const ContactProblem& p, std::size_t device_index, int touches) {
  const ProfiledDevice profiled(device_index);
  service::ElasticitySolverOptions solver_options;
  solver_options.precision = service::SolvePrecision::kDouble;
  service::ElasticitySolver solver(profiled.device(), p.tissue.grid, p.tissue.supports, solver_options);
  solver.set_material(p.tissue.material);
  std::vector<double> load(p.tissue.grid.dofs(), 0.0);
  for (const std::size_t dof : p.contact_dofs) load[dof] = 1;
  for (int k = 0; k < touches; ++k) {
    std::vector<double> u(load.size(), 0.0);
    solver.solve(1, load, {}, u);
  }
  return profiled.profile(solver.queue(), work_of(p.tissue.grid, profiled.device()->queue()), touches);
}

}  // namespace teletact::bench
