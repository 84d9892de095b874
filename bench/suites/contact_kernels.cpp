// The kernels of the device's conjugate gradients against what the device can do (acceptance 8).
#include <fmt/format.h>

#include <cstdio>

#include "bench/roofline.h"
#include "bench/suites/contact.h"
#include "service/solver/multigrid.h"
#include "service/tissue/elasticity_solver.h"

namespace teletact::bench {
namespace {

using nlohmann::json;

// Of one launch and right-hand side, in double. Kernels of multigrid run once on each level but the coarsest:
// the mean of these counts. Reads and writes in reals per node, flops likewise, from the kernels' comments.
std::map<std::string, Work> work_of(const service::TissueGrid& grid, const service::Queue& queue) {
  constexpr double kReal = sizeof(double);
  const double fine = static_cast<double>(grid.nodes());
  const service::Multigrid<double> multigrid(queue, {grid.x_m, grid.y_m});
  double nx = static_cast<double>(grid.nx()), ny = static_cast<double>(grid.ny()), sum = 0;
  for (std::size_t level = 0; level + 1 < multigrid.levels(); ++level) {
    sum += nx * ny;
    nx = (nx + 1) / 2, ny = (ny + 1) / 2;
  }
  const double mean = sum / static_cast<double>(multigrid.levels() - 1), coarsest = 2 * nx * ny;
  const auto per = [](double nodes, double reals, double flops) {
    return Work{nodes * reals * kReal, nodes * flops};
  };
  return {{"elasticity_apply", per(fine, 2 + 2 + 2 + 1, 240)},
          {"elasticity_stencil", per(fine, 36 + 2 + 1, 600)},
          {"stencil_residual", per(mean, 36 + 6, 74)},
          {"stencil_apply", per(mean, 36 + 4, 72)},
          {"cell_step", per(mean, 36 + 2 + 4 + 4, 80)},
          {"relax_interior", per(mean / 4, 36 + 18 + 2 + 4 + 4, 82)},
          {"restrict_residual", per(mean, 2 + 0.5, 4.5)},
          {"prolong_add", per(mean, 0.5 + 4, 8)},
          {"dense_apply", {coarsest * coarsest * kReal, 2 * coarsest * coarsest}},
          {"dot_two", per(fine, 8, 8)},
          {"pcg_update", per(fine, 12, 8)},
          {"pcg_direction", per(fine, 6, 4)}};
}

void print(const json& rows, const Ceiling& ceiling, const std::string& device) {
  double seconds = 0;
  for (const json& row : rows) seconds += row.at("seconds").get<double>();
  std::printf("kernels of one touch on %s: %.1f GB/s and %.0f GFLOP/s (float) measured at most\n",
              device.c_str(), 1e-9 * ceiling.bytes_s, 1e-9 * ceiling.flops_s);
  for (const json& row : rows) {
    const double s = row.at("seconds"), share = s / seconds;
    if (share < 0.05) continue;
    std::printf("  %-20s %4.0f %% of the time, %6.1f launches", row.at("kernel").get<std::string>().c_str(),
                100 * share, row.at("launches").get<double>());
    if (row.contains("bytes"))
      std::printf(", %5.1f GB/s, %5.1f GFLOP/s, %.2f of the %s limit", 1e-9 * row["bytes"].get<double>() / s,
                  1e-9 * row["flops"].get<double>() / s, row["of_limit"].get<double>(),
                  row["bound"].get<std::string>().c_str());
    std::printf("\n");
  }
}

}  // namespace

json measure_kernels(const ContactProblem& p, std::size_t device_index, int touches) {
  service::DeviceOptions options;
  options.select = std::to_string(device_index);
  const Ceiling ceiling = measure_ceiling(service::Device::open(options)->queue());
  options.profiling = true;
  const auto device = service::Device::open(options);
  service::ElasticitySolverOptions solver_options;
  solver_options.precision = service::SolvePrecision::kDouble;
  service::ElasticitySolver solver(device, p.tissue.grid, p.tissue.supports, solver_options);
  solver.set_material(p.tissue.material);
  std::vector<double> load(p.tissue.grid.dofs(), 0.0);
  for (const std::size_t dof : p.contact_dofs) load[dof] = 1;
  for (int k = 0; k < touches; ++k) {
    std::vector<double> u(load.size(), 0.0);
    solver.solve(1, load, {}, u);
  }
  const json rows = kernels_of(solver.queue(), work_of(p.tissue.grid, device->queue()), ceiling, touches);
  print(rows, ceiling, device->info().name);
  return {{"bytes_s", ceiling.bytes_s}, {"flops_s", ceiling.flops_s}, {"kernels", rows}};
}

}  // namespace teletact::bench
