// CreateScene: geometry, an explicit modulus, slices; the scene is made of what is taken.
#include <cmath>

#include "service/rpc/palpation_messages.h"
#include "service/scene/errors.h"
#include "service/scene/scenes.h"
#include "tests/fuzzers/service/fuzzers.h"
#include "tests/scene/create_scene.h"

namespace teletact::fuzzers {
namespace {

using namespace service;

// So small that a scene is made in milliseconds.
Limits small() {
  Limits limits;
  limits.max_scene_columns = 17;
  limits.max_scene_elements = limits.max_solid_elements = 256;
  limits.max_scene_width_m = limits.max_scene_depth_m = 0.1;
  return limits;
}

void check(const SceneGeometry& geometry, const Limits& limits) {
  require(geometry.width_m >= limits.min_scene_m && geometry.width_m <= limits.max_scene_width_m &&
              geometry.depth_m >= limits.min_scene_m && geometry.depth_m <= limits.max_scene_depth_m,
          "a scene beyond the limits");
  require(geometry.poisson_ratio >= 0 && geometry.poisson_ratio < 0.5, "a Poisson ratio that cannot be");
}

void check(const ExplicitModulus& e, const Limits& limits) {
  const std::size_t elements = (e.x_m.size() - 1) * (e.y_m.size() - 1) * e.slices();
  require(elements > 0 && elements <= limits.max_solid_elements, "more elements than the limits");
  require(e.youngs_modulus_pa.size() == elements, "a modulus that does not fill its grid");
  require(e.log_deviation.empty() || e.log_deviation.size() == elements,
          "deviations that do not fill the grid");
  for (std::size_t n = 1; n < e.slices_m.size(); ++n)
    require(e.slices_m[n - 1] < e.slices_m[n], "slices out of order");
}

void check(Scene& scene) {
  require((scene.snapshot()->version > 0) == !scene.snapshot()->windows.empty(),
          "a version of nothing, or none of what is there");
  v1::Scene message;
  scene_to(scene, v1::SCENE_VIEW_FULL, 1, &message);
  require(message.ByteSizeLong() > 0, "a scene that cannot be told");
  const auto snapshot = scene.snapshot();
  for (const auto& window : snapshot->windows)
    require(window->region.begin_x_m < window->region.end_x_m, "a window that ends before it begins");
}

}  // namespace

bool create_scene(Bytes bytes) {
  require_plain_log();
  static const Limits limits = small();
  static Scenes scenes("", limits);
  v1::CreateSceneRequest request;
  if (!request.ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) return false;
  SceneGeometry geometry;
  std::optional<ExplicitModulus> modulus;
  if (!accepted<std::invalid_argument, Error>([&] {
        geometry = geometry_from(request.geometry(), limits);
        modulus = modulus_from(request, limits);
      }))
    return false;
  check(geometry, limits);
  if (modulus) check(*modulus, limits);
  std::shared_ptr<Scene> scene;
  if (!accepted<std::invalid_argument, std::domain_error, Error>(
          [&] { scene = service::create_scene(scenes, request.scene_id(), geometry, std::move(modulus)); }))
    return false;
  check(*scene);
  scenes.remove(scene->id());
  return true;
}

}  // namespace teletact::fuzzers
