// The kernels of the device's conjugate gradients against what the device can do (acceptance 8).
#include <fmt/format.h>

#include <cstdio>

#include "bench/roofline.h"
#include "bench/suites/contact/contact.h"
#include "service/solver/multigrid.h"
#include "service/tissue/elasticity_solver.h"

namespace teletact::bench {
namespace {

using nlohmann::json;

// Of one launch and right-hand side, from the kernels' comments: conjugate gradients in double, multigrid in
// float. A step of multigrid is a launch on each level that is not small: the mean of these; `run_steps` is
// all of them on the small levels. Each array counts once.
std::map<std::string, Work> work_of(const service::TissueGrid& grid, const service::Queue& queue) {
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
  std::map<std::string, Work> work{{"elasticity_apply", per(2 + 2 + 2 + 2, 240)},
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
