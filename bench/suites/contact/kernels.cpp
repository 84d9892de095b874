// The kernels of the device's conjugate gradients against what the device can do (acceptance 8).
#include "bench/suites/contact/contact.h"
#include "service/solver/multigrid.h"
#include "service/tissue/elasticity_solver.h"

namespace teletact::bench {
namespace {

struct Nodes {
  double launched = 0;  // of the levels on which a step is a launch of its own, the mean over these; 0: none
  double in_one = 0;    // that the steps of a kind go over in the one launch of the small levels, together
};

Nodes nodes_of(const service::Multigrid<double, float>& multigrid, service::CycleStep step) {
  Nodes nodes;
  double launches = 0;
  for (const service::PlannedStep& s : multigrid.plan()) {
    if (s.step != step) continue;
    const auto level = static_cast<std::size_t>(s.level);
    const auto of_level = static_cast<double>(multigrid.nodes(level));
    if (level >= multigrid.first_small())
      nodes.in_one += of_level;
    else
      nodes.launched += of_level, ++launches;
  }
  if (launches > 0) nodes.launched /= launches;
  return nodes;
}

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
  const double solves = nodes_of(multigrid, CycleStep::kSolve).in_one,
               unknowns = 2 * static_cast<double>(multigrid.nodes(multigrid.levels() - 1));
  Work& small = work["run_steps"];
  small = {solves * 2 * unknowns * sizeof(float), solves * 2 * unknowns * 2};
  for (const auto& s : steps) {
    const auto [launched, in_one] = nodes_of(multigrid, s.step);
    work.try_emplace(s.kernel, Work{launched * s.bytes, launched * s.flops});
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
  service::ElasticitySolver solver(profiled.device(), p.tissue.grid, p.tissue.supports, p.tissue.material,
                                   solver_options);
  std::vector<double> load(p.tissue.grid.dofs(), 0.0);
  for (const std::size_t dof : p.contact_dofs) load[dof] = 1;
  solver.queue().take_work();
  for (int k = 0; k < touches; ++k) {
    std::vector<double> u(load.size(), 0.0);
    solver.solve(1, load, u);
  }
  return profiled.profile(solver.queue(), work_of(p.tissue.grid, profiled.device()->queue()), touches);
}

}  // namespace teletact::bench
