#include "service/scene/window_tissue.h"

#include <algorithm>
#include <cmath>

#include "service/base/choices.h"

namespace teletact::service {

namespace {

using namespace choices;

struct Range {
  double begin_m, end_m;
};

Range widened(const SceneGeometry& g, double begin_m, double end_m, double by_m) {
  return {std::max(0.0, begin_m - by_m), std::min(g.width_m, end_m + by_m)};
}

}  // namespace

std::vector<double> window_rows_m(const SceneGeometry& g) {
  if (g.depth_m <= kFineDepth + kCoarseRow)
    return uniform_coordinates(0, g.depth_m,
                               std::max<std::size_t>(1, std::llround(std::ceil(g.depth_m / kFine - 1e-9))));
  return graded_coordinates(0, g.depth_m, 0, kFineDepth, kFine, kCoarseRow, kRowGrowth);
}

std::vector<double> window_columns_m(const SceneGeometry& g, double begin_m, double end_m) {
  const Range reach = widened(g, begin_m, end_m, kHandOver + kWidestReach);
  // On the scene's lattice of fine columns.
  const double fine_begin_m = std::max(0.0, std::floor(reach.begin_m / kFine + 1e-9) * kFine);
  const double fine_end_m = std::min(g.width_m, std::ceil(reach.end_m / kFine - 1e-9) * kFine);
  const Range whole = widened(g, begin_m, end_m, kContext);
  return graded_coordinates(std::min(whole.begin_m, fine_begin_m), std::max(whole.end_m, fine_end_m),
                            fine_begin_m, fine_end_m, kFine, kCoarse, kColumnGrowth);
}

std::shared_ptr<const TissueModel> build_window_tissue(const SceneGeometry& g, const StitchedMap& map,
                                                       double begin_m, double end_m,
                                                       const WindowTissueOptions& o,
                                                       const TissueModel* before) {
  TissueGrid grid{window_columns_m(g, begin_m, end_m), window_rows_m(g)};
  Material material;
  material.poisson_ratio = g.poisson_ratio;
  material.youngs_modulus_pa.reserve(grid.elements());
  for (std::size_t j = 0; j + 1 < grid.ny(); ++j)
    for (std::size_t i = 0; i + 1 < grid.nx(); ++i)
      material.youngs_modulus_pa.push_back(
          map.mean_modulus_pa(grid.x_m[i], grid.x_m[i + 1], grid.y_m[j], grid.y_m[j + 1]));
  Supports supports = g.supports;
  if (grid.x_m.front() > 0) supports.left = EdgeSupport::kFree;
  if (grid.x_m.back() < g.width_m) supports.right = EdgeSupport::kFree;
  const Range reach = widened(g, begin_m, end_m, kHandOver + kWidestReach);
  TissueModelOptions options;
  options.touch_begin_m = reach.begin_m;
  options.touch_end_m = reach.end_m;
  options.thickness_m = g.thickness_m;
  options.interior_layers = o.interior_layers;
  options.will_change = true;
  options.account = o.account;
  return std::make_shared<const TissueModel>(std::move(grid), std::move(material), supports, options, before);
}

}  // namespace teletact::service
