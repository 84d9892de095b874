#include "service/tissue/tissue_problem.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "service/tissue/condensation.h"

namespace teletact::service {
namespace {

ColumnRange touchable_columns(const TissueGrid& grid, const FreeNodes& free, double begin, double end) {
  ColumnRange range{free.first_column, free.last_column};
  if (begin == 0 && end == 0) return range;
  if (!std::isfinite(begin) || !std::isfinite(end) || begin > end) {
    throw std::invalid_argument(
        "options.touch_begin_m and touch_end_m must be finite and in order; both 0 keeps every column");
  }
  const double slack = 1e-9 * (grid.x_m.back() - grid.x_m.front());
  while (range.first <= range.last && grid.x_m[range.first] < begin - slack) ++range.first;
  while (range.last > range.first && grid.x_m[range.last] > end + slack) --range.last;
  if (range.first > range.last || grid.x_m[range.last] > end + slack) {
    throw std::invalid_argument(fmt::format(
        "options.touch_begin_m ... touch_end_m, {} to {}, holds no free column of nodes; widen it", begin,
        end));
  }
  return range;
}

}  // namespace

TissueProblem make_problem(TissueGrid grid, Material material, const Supports& supports,
                           const TissueModelOptions& o) {
  validate(grid, material);
  const FreeNodes free = free_nodes(grid, supports);
  if (!(o.thickness_m > 0) || !std::isfinite(o.thickness_m)) {
    throw std::invalid_argument(fmt::format(
        "options.thickness_m is {}; give the out-of-plane contact width in metres, above 0", o.thickness_m));
  }
  const ColumnRange touchable = touchable_columns(grid, free, o.touch_begin_m, o.touch_end_m);
  const bool everywhere = o.touch_begin_m == 0 && o.touch_end_m == 0;
  const double begin_m = everywhere ? grid.x_m.front() : o.touch_begin_m,
               end_m = everywhere ? grid.x_m.back() : o.touch_end_m;
  return {std::move(grid), std::move(material), supports, o.thickness_m, begin_m, end_m, touchable};
}

double modulus_near_pa(const TissueProblem& problem, std::size_t column, std::size_t row) {
  const TissueGrid& grid = problem.grid;
  if (column >= grid.nx() || row >= grid.ny()) {
    throw std::out_of_range("modulus_near_pa: column or row outside the grid");
  }
  const std::size_t below = std::min(row, grid.ny() - 2);
  const std::size_t left = column > 0 ? column - 1 : 0, right = std::min(column, grid.nx() - 2);
  return (problem.material.youngs_modulus_pa[grid.element(left, below)] +
          problem.material.youngs_modulus_pa[grid.element(right, below)]) /
         2;
}

}  // namespace teletact::service
