#include "service/rpc/cell_view.h"

#include <algorithm>
#include <cmath>

namespace teletact::service {

namespace {

std::size_t slice_in_the_middle(const ExplicitModulus& e) {
  if (!e.solid()) return 0;
  const double middle_m = (e.z_m.front() + e.z_m.back()) / 2;
  std::size_t nearest = 0;
  for (std::size_t n = 1; n < e.slices(); ++n)
    if (std::abs(e.slice_m(n) - middle_m) < std::abs(e.slice_m(nearest) - middle_m)) nearest = n;
  return nearest;
}

std::size_t element_at(const std::vector<double>& nodes_m, double at_m) {
  const auto after = std::upper_bound(nodes_m.begin() + 1, nodes_m.end() - 1, at_m);
  return static_cast<std::size_t>(after - nodes_m.begin()) - 1;
}

void add(const Cell& cell, CellView& out) {
  out.modulus_pa.push_back(cell.modulus_pa);
  out.log_deviation.push_back(cell.log_deviation);
  out.valid.push_back(cell.state == CellState::kMeasured);
}

}  // namespace

ImageGrid cells_of(const SceneSnapshot& snapshot, const SceneGeometry& geometry) {
  const auto of = [](const StitchedMap& map) -> ImageGrid {
    return {map.nx(), map.ny(), map.cell_x_m() / 2, map.cell_y_m() / 2, map.cell_x_m(), map.cell_y_m()};
  };
  return snapshot.map ? of(*snapshot.map) : of(StitchedMap(geometry));
}

CellView view_of(const SceneSnapshot& snapshot, const SceneGeometry& geometry, std::size_t begin,
                 std::size_t end) {
  CellView view{cells_of(snapshot, geometry), {}, {}, {}};
  ImageGrid& grid = view.grid;
  end = std::min(end, grid.nx);
  grid.origin_x_m += grid.dx_m * static_cast<double>(begin);
  grid.nx = end - begin;
  const auto each = [&](const auto& cell_at) {
    for (std::size_t j = 0; j < grid.ny; ++j)
      for (std::size_t i = begin; i < end; ++i) add(cell_at(i, j), view);
  };
  if (!snapshot.modulus) {
    each([&](std::size_t i, std::size_t j) { return snapshot.map->cells().at(i, j); });
    return view;
  }
  const ExplicitModulus& e = *snapshot.modulus;
  const std::size_t first = slice_in_the_middle(e) * (e.x_m.size() - 1) * (e.y_m.size() - 1);
  each([&](std::size_t i, std::size_t j) -> Cell {
    const auto middle_m = [](std::size_t n, double step_m) {
      return (static_cast<double>(n) + 0.5) * step_m;
    };
    const std::size_t n = first + element_at(e.x_m, middle_m(i, grid.dx_m)) +
                          (e.x_m.size() - 1) * element_at(e.y_m, middle_m(j, grid.dy_m));
    return {static_cast<float>(e.youngs_modulus_pa[n]), CellState::kMeasured,
            e.log_deviation.empty() ? 0 : static_cast<float>(e.log_deviation[n])};
  });
  return view;
}

}  // namespace teletact::service
