// An iteration on solids, in float.
#include <cmath>
#include <utility>

#include "bench/solid_blocks.h"
#include "bench/suites/device/device.h"
#include "service/tissue/solid/solid_solver.h"

namespace teletact::bench {
namespace {

// Of one launch, from the kernels' comments and loops; every array counts once.
Works work_of(const service::SolidGrid& grid) {
  const double nodes = double(grid.elements()), planes = double(3 * grid.layers());
  const double field = nodes * sizeof(float), pitch = double((grid.nx / 2 + 8) / 8 * 8);
  const double waves = pitch * double(grid.nz * grid.layers());  // complex numbers of a component's spectrum
  const double blocks = pitch * double((grid.nz / 2 + 1) * grid.layers()) * sizeof(float);
  const double spectrum = 6 * waves * sizeof(float);
  const double columns = double(grid.columns());
  const Work transform{3 * field + spectrum, planes * 2.5 * columns * std::log2(columns)};
  return {{"solid_apply", {7 * field, 186 * nodes}},
          {"solid_advance", {13 * field, 1158 * nodes}},
          {"solid_direction", {9 * field, 6 * nodes}},
          {"step_forward", {transform.bytes + 15 * field, transform.flops + 12 * nodes}},
          {"backward_dot", {transform.bytes + 3 * field, transform.flops + 6 * nodes}},
          {"columns", {2 * spectrum, planes * 1.25 * columns * std::log2(columns)}},
          {"layers_up", {2 * spectrum + 9 * blocks, 36 * waves}},
          {"layers_down", {2 * spectrum + 15 * blocks, 66 * waves}}};
}

DeviceStage make(const std::string& name, const service::SolidGrid& grid,
                 const std::shared_ptr<service::Device>& device) {
  constexpr std::size_t kIterations = 20;
  const service::Queue queue = device->queue();
  const auto solver =
      std::make_shared<service::SolidSolver<float>>(queue, solid_tissue(grid, 0.49, SolidLump{}));
  const auto iterate = [solver, load = hertz_load(grid)](std::size_t most) {
    solver->load(load.unknowns, load.values, {.relative_error = 0, .max_iterations = most});
  };
  constexpr std::size_t kFirst = 2;  // what a solve begins with is none of an iteration's
  return {"solid of " + name + " nodes, an iteration",
          queue,
          [iterate] { iterate(kFirst + kIterations); },
          [iterate] { iterate(kFirst); },
          double(kIterations),
          work_of(grid)};
}

}  // namespace

void measure_solids(DevicePart& part) {
  std::vector<std::pair<std::string, service::SolidGrid>> sizes{{"4 k", solid_grid(32, 16, 8, 0.004, 0.004)}};
  if (!part.quick) sizes.insert(sizes.end(), {{"70 k", solid_70k()}, {"336 k", solid_336k()}});
  for (const auto& [name, grid] : sizes)
    part.measure([&](const auto& device) { return make(name, grid, device); });
}

}  // namespace teletact::bench
