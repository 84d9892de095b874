#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <stdexcept>

#include "service/base/choices.h"
#include "service/contact/plane_touch_model.h"
#include "service/contact/solid_touch_model.h"
#include "service/scene/solid_block.h"
#include "service/scene/touch_models.h"
#include "service/scene/window_tissue.h"

namespace teletact::service {
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

  void warm(const std::shared_ptr<Device>& device) const override { warm_iterative(device); }
};

}  // namespace

std::shared_ptr<const TouchModels> tissue_models() {
  static const auto models = std::make_shared<const TissueModels>();
  return models;
}

}  // namespace teletact::service
