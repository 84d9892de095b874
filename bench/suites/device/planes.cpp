// Planes by conjugate gradients, as the product solves them: squares of nodes under a touch's load, and a
// scene's window under a batch of loads.
#include <algorithm>
#include <string>

#include "bench/peers/contact_case.h"
#include "bench/suites/device/device.h"
#include "service/scene/tissue_models.h"
#include "service/solver/multigrid.h"
#include "service/tissue/iterative_compliances.h"

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

// Of one launch (one right-hand side but for `elasticity_apply`), from the kernels' comments: conjugate
// gradients in double, multigrid in float. A step of multigrid is a launch on each level that is not small:
// the mean of these; `run_steps` is all of them on the small levels. Each array counts once.
Works work_of(const service::TissueGrid& grid, double columns, const service::Queue& queue) {
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
  Works work{{"elasticity_apply", per((2 + 2) * columns + 2 + 2, 240 * columns)},
             {"elasticity_stencil", per(36 + 2 + 1, 600)},
             {"dot_two", per(8, 8)},
             {"pcg_update", per(12, 12)},
             {"pcg_direction", per(6, 4)}};
  // Through the inverse of each block, to and back; couplings; the operator, from differences; vectors. A
  // flop in double counts as two.
  const auto unknowns_of_block = static_cast<double>(2 * std::min(grid.nx(), grid.ny()));
  work["solve_whole"] = per(2 * (unknowns_of_block + 18 + 8 * columns),
                            columns * 2 * 2 * (4 * unknowns_of_block + 24 + 52 + 14));
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

DeviceStage make(const std::string& name, const reference::TouchedTissue& tissue, std::size_t columns,
                 const std::shared_ptr<service::Device>& device) {
  const service::ElasticitySolverOptions options =
      service::iterative_options(*device, tissue.material.poisson_ratio);
  const auto solver = std::make_shared<service::ElasticitySolver>(device, tissue.grid, tissue.supports,
                                                                  tissue.material, options);
  return {name,
          solver->queue(),
          [=, loads = surface_loads(tissue.grid, columns)] {
            std::vector<double> u(loads.size());
            solver->solve(columns, loads, u);
          },
          {},
          1,
          work_of(tissue.grid, double(columns), device->queue())};
}

}  // namespace

std::vector<double> surface_loads(const service::TissueGrid& grid, std::size_t count) {
  std::vector<double> loads(count * grid.dofs());
  for (std::size_t q = 0; q < count; ++q)
    loads[q * grid.dofs() + 2 * grid.node((2 * q + 1) * grid.nx() / (2 * count), 0) + 1] = 1;
  return loads;
}

reference::TouchedTissue scene_window() {
  service::SceneGeometry geometry;
  geometry.width_m = 0.260, geometry.depth_m = 0.040;
  reference::TouchedTissue tissue;
  tissue.grid = {service::window_columns_m(geometry, 0.100, 0.160), service::window_rows_m(geometry)};
  tissue.supports = geometry.supports;
  tissue.material = {std::vector<double>(tissue.grid.elements(), 10e3), geometry.poisson_ratio};
  for (std::size_t e = 0; e < tissue.grid.elements(); e += 7) tissue.material.youngs_modulus_pa[e] = 100e3;
  return tissue;
}

void measure_planes(DevicePart& part) {
  constexpr std::size_t kBatch = 32;
  for (const std::size_t nodes : {61, 241})
    if (nodes == 61 || !part.quick)
      part.measure([&](const auto& device) {
        return make(std::to_string(nodes) + " x " + std::to_string(nodes) + " nodes, a load",
                    make_tissue({nodes, nodes}), 1, device);
      });
  const reference::TouchedTissue window = scene_window();
  part.measure([&](const auto& device) {
    return make(
        std::to_string(window.grid.nx()) + " x " + std::to_string(window.grid.ny()) + " nodes, 32 loads",
        window, kBatch, device);
  });
}

}  // namespace teletact::bench
