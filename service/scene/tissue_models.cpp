#include "service/scene/tissue_models.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <stdexcept>
#include <string>

#include "service/base/choices.h"
#include "service/contact/plane_touch_model.h"
#include "service/contact/solid_touch_model.h"
#include "service/device/cancellation.h"
#include "service/scene/slices.h"
#include "service/scene/touch_models.h"

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

namespace {

// The spacing of evenly spaced nodes.
double spacing_of(const std::vector<double>& nodes_m, const char* field) {
  const double spacing = (nodes_m.back() - nodes_m.front()) / static_cast<double>(nodes_m.size() - 1);
  for (std::size_t n = 0; n + 1 < nodes_m.size(); ++n)
    if (!(std::abs(nodes_m[n + 1] - nodes_m[n] - spacing) <= 1e-6 * spacing))
      throw std::invalid_argument(fmt::format(
          "{}: solid tissue takes increasing, evenly spaced nodes; {} m follows {} m where the mean "
          "distance is {} m",
          field, nodes_m[n + 1], nodes_m[n], spacing));
  return spacing;
}

// Columns of the block: those given and some around, a power of two.
std::size_t padded(std::size_t given, double spacing_m, const char* field) {
  const auto around = static_cast<std::size_t>(std::ceil(choices::kSolidPadding / spacing_m));
  const std::size_t columns = std::bit_ceil(given + around);
  constexpr std::size_t kMax = 512;
  if (columns > kMax)
    throw std::invalid_argument(
        fmt::format("{}: {} columns and {} around them are more than {}; use a coarser grid", field, given,
                    around, kMax));
  return columns;
}

// What a block may take: its own elements, and columns of the tissue that is so wide that its period is not
// felt (SolidContact).
void require_modelled(const SolidGrid& grid) {
  if (grid.layers() > choices::kMaxBlockElements / grid.columns())
    throw std::invalid_argument(fmt::format(
        "modulus: {} x {} x {} elements with the tissue around them, at most {} are modelled; use a "
        "coarser grid",
        grid.nx, grid.layers(), grid.nz, choices::kMaxBlockElements));
  const double period_m = choices::kMinPeriod * grid.y_m.back();
  if (period_m > choices::kMaxWideColumns * grid.spacing_x_m)
    throw std::invalid_argument(
        fmt::format("modulus.x_m: {} m between nodes is too fine for tissue {} m deep", grid.spacing_x_m,
                    grid.y_m.back()));
  if (period_m > choices::kMaxWideColumns * grid.spacing_z_m)
    throw std::invalid_argument(
        fmt::format("modulus.z_m: {} m between nodes is too fine for tissue {} m deep", grid.spacing_z_m,
                    grid.y_m.back()));
}

// Of a column of the block, the given one: beyond the last, its own, and from half of the way round the
// first.
std::size_t given_of(std::size_t column, std::size_t given, std::size_t columns) {
  if (column < given) return column;
  return column < given + (columns - given) / 2 ? given - 1 : 0;
}

// The columns along z that `wanted`.
template <class Wanted>
void fill(SolidBlock& block, const ExplicitModulus& e, const Wanted& wanted) {
  const SolidGrid& grid = block.tissue.grid;
  const std::size_t given_x = e.x_m.size() - 1, layers = grid.layers();
  const auto given_z =
      static_cast<std::size_t>(std::lround((e.z_m.back() - e.z_m.front()) / grid.spacing_z_m));
  for (std::size_t k = 0; k < grid.nz; ++k) {
    const auto column = static_cast<double>(given_of(k, given_z, grid.nz));
    const Between at = between(e, block.origin_z_m + (column + 0.5) * grid.spacing_z_m);
    if (!wanted(at)) continue;
    check_cancelled();
    for (std::size_t j = 0; j < layers; ++j)
      for (std::size_t i = 0; i < grid.nx; ++i) {
        const std::size_t x = j * given_x + given_of(i, given_x, grid.nx);
        const double near = e.youngs_modulus_pa[at.before * layers * given_x + x],
                     far = e.youngs_modulus_pa[at.after * layers * given_x + x];
        block.tissue.youngs_modulus_pa[(j * grid.nz + k) * grid.nx + i] =
            at.share > 0 ? near * std::pow(far / near, at.share) : near;
      }
  }
  block.log_deviation = e.log_deviation.empty() ? 0 : std::ranges::min(e.log_deviation);
}

}  // namespace

SolidBlock solid_block(const SceneGeometry& geometry, const ExplicitModulus& e) {
  if (geometry.supports != Supports{})
    throw std::invalid_argument(
        "geometry.supports: a solid is held at its bottom alone; leave geometry.supports out");
  const double spacing_x = spacing_of(e.x_m, "modulus.x_m"), pitch_z = spacing_of(e.z_m, "modulus.z_m");
  const std::size_t given_x = e.x_m.size() - 1, given_z = e.z_m.size() - 1;
  const double extent_z = e.z_m.back() - e.z_m.front();
  if (extent_z > choices::kWidestSolid)
    throw std::invalid_argument(fmt::format("modulus.z_m: reaches over {} m, at most {} are modelled",
                                            extent_z, choices::kWidestSolid));
  const auto parts = static_cast<std::size_t>(std::ceil(pitch_z / choices::kSolidSpacing - 1e-9));
  SolidBlock block;
  SolidGrid& grid = block.tissue.grid;
  grid.spacing_x_m = spacing_x;
  grid.spacing_z_m = pitch_z / static_cast<double>(parts);
  grid.y_m = e.y_m;
  grid.nx = padded(given_x, grid.spacing_x_m, "modulus.x_m");
  grid.nz = padded(given_z * parts, grid.spacing_z_m, "modulus.z_m");
  require_modelled(grid);
  block.tissue.poisson_ratio = geometry.poisson_ratio;
  block.origin_x_m = e.x_m.front();
  block.origin_z_m = e.z_m.front();
  const double inf = HUGE_VAL;  // the last column belongs to it
  block.region = {e.x_m.front(), std::nextafter(e.x_m.back(), inf),
                  RangeZ{e.z_m.front(), std::nextafter(e.z_m.back(), inf)}};
  grow(block.tissue.youngs_modulus_pa, grid.elements(), 0.0);
  fill(block, e, [](const Between&) { return true; });
  validate(block.tissue);
  return block;
}

SolidBlock solid_block(const SolidBlock& before, const ExplicitModulus& e, std::optional<std::size_t> slice) {
  SolidBlock block = before;
  fill(block, e, [slice](const Between& at) { return !slice || at.before == slice || at.after == slice; });
  return block;
}

namespace {

std::size_t row_of(const TissueModel& tissue, const Layer& layer) {
  const std::vector<double>& y_m = tissue.problem().grid.y_m;
  return static_cast<std::size_t>(std::find(y_m.begin(), y_m.end(), layer.depth_m) - y_m.begin());
}

class TissueModels final : public TouchModels {
 public:
  std::vector<Layer> layers(const SceneGeometry& geometry) const override {
    return free_layers(window_rows_m(geometry), geometry.supports);
  }

  double context_m() const override { return choices::kRefresh; }

  void check(bool solid, const Fingertip& tip, const Layer&, const TouchWay& way) const override {
    const bool pad = tip.shape == FingertipShape::kPad;
    if (!solid && (pad || tip.shape == FingertipShape::kSphere))
      throw std::invalid_argument(
          fmt::format("open.fingertip.shape: a {} touches solid tissue (CreateScene with modulus.z_m); touch "
                      "a plane scene with a flat punch or a rounded tip",
                      pad ? "pad" : "sphere"));
    if (way.path == SolvePath::kShares && (!way.shares || way.pressure))
      throw std::invalid_argument(
          "open.path: SHARES is a closed form of a frictionless ROUNDED_TIP or SPHERE on a solid's surface, "
          "without pressures or tactile images; leave the path out");
  }

  std::shared_ptr<const TouchModel> of_window(const WantedModel& wanted) const override {
    WindowTissueOptions options;
    options.account = wanted.account;
    options.interior_layers = std::any_of(wanted.in_use.begin(), wanted.in_use.end(),
                                          [](const Layer& layer) { return layer.depth_m > 0; });
    const TissueModel* before = wanted.before ? wanted.before->made_of().plane.get() : nullptr;
    auto tissue = build_window_tissue(wanted.geometry, wanted.map, wanted.region.begin_x_m,
                                      wanted.region.end_x_m, options, before);
    for (const Layer& layer : wanted.in_use) try {
        tissue->compliance(row_of(*tissue, layer));
      } catch (
          const MemoryRefused& refused) {  // who touches it finds it unprepared; others have their window
        spdlog::warn("event=layer_not_prepared depth_m={} error=\"{}\"", layer.depth_m, refused.what());
      }
    return std::make_shared<const PlaneTouchModel>(std::move(tissue), wanted.account);
  }

  std::shared_ptr<const TouchModel> of_modulus(const SceneGeometry& geometry, const ExplicitModulus& e,
                                               const MemoryAccount& account) const override {
    if (e.solid()) return std::make_shared<const SolidTouchModel>(solid_block(geometry, e), account);
    TissueModelOptions options;
    options.touch_begin_m = e.x_m.front();
    options.touch_end_m = e.x_m.back();
    options.thickness_m = geometry.thickness_m;
    options.account = account;
    return std::make_shared<const PlaneTouchModel>(
        std::make_shared<const TissueModel>(TissueGrid{e.x_m, e.y_m},
                                            Material{e.youngs_modulus_pa, geometry.poisson_ratio},
                                            geometry.supports, options),
        account);
  }

  std::shared_ptr<const TouchModel> of_slice(const SceneGeometry& geometry, const ExplicitModulus& e,
                                             std::optional<std::size_t> slice, const TouchModel& before,
                                             const MemoryAccount& account) const override {
    const std::shared_ptr<SolidState>& solid = before.made_of().solid;
    if (!solid) return of_modulus(geometry, e, account);
    return std::make_shared<const SolidTouchModel>(solid_block(solid->block, e, slice), account, solid);
  }

  void warm(const std::shared_ptr<Device>& device) const override {
    warm_iterative(device);
    warm_solids(device);
  }
};

}  // namespace

std::shared_ptr<const TouchModels> tissue_models() {
  static const auto models = std::make_shared<const TissueModels>();
  return models;
}

}  // namespace teletact::service
