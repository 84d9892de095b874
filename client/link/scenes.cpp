#include "client/link/scenes.h"

#include <algorithm>

namespace teletact::client {

void name_scene(grpc::ClientContext& context, const std::string& scene_id) {
  const auto plain = [](char c) { return c > ' ' && c <= '~'; };  // gRPC ends the process over others
  if (!scene_id.empty() && std::ranges::all_of(scene_id, plain))
    context.AddMetadata("teletact-scene", scene_id);
}

grpc::Status get_scene(v1::Palpation::Stub& stub, const std::string& scene_id, v1::SceneView view,
                       v1::Scene& scene, std::chrono::seconds within) {
  grpc::ClientContext context;
  name_scene(context, scene_id);
  if (within.count() > 0) context.set_deadline(std::chrono::system_clock::now() + within);
  v1::GetSceneRequest request;
  request.set_scene_id(scene_id);
  request.set_view(view);
  return stub.GetScene(&context, request, &scene);
}

const char* kind_of(const v1::Scene& scene) {
  switch (scene.kind()) {
    case v1::SCENE_KIND_PLANE:
      return "plane";
    case v1::SCENE_KIND_EXTRUDED:
      return "extruded";
    case v1::SCENE_KIND_SOLID:
      return "solid";
    default:
      return "tissue";
  }
}

std::vector<Extent> touchable_extents(const v1::Scene& scene) {
  constexpr double kRoundingM = 1e-6;
  std::vector<Extent> windows, extents;
  for (const v1::Window& window : scene.windows())
    if (window.touchable()) windows.push_back({window.covers().begin_x_m(), window.covers().end_x_m()});
  std::sort(windows.begin(), windows.end(),
            [](const Extent& a, const Extent& b) { return a.begin_x_m < b.begin_x_m; });
  for (const Extent& window : windows) {
    if (extents.empty() || window.begin_x_m > extents.back().end_x_m + kRoundingM)
      extents.push_back(window);
    else
      extents.back().end_x_m = std::max(extents.back().end_x_m, window.end_x_m);
  }
  return extents;
}

std::optional<Extent> touchable_extent(const v1::Scene& scene) {
  const std::vector<Extent> extents = touchable_extents(scene);
  if (extents.empty()) return std::nullopt;
  return Extent{extents.front().begin_x_m, extents.back().end_x_m};
}

std::optional<ExtentZ> touchable_extent_z(const v1::Scene& scene) {
  for (const v1::Window& window : scene.windows())
    if (window.touchable() && window.covers().has_begin_z_m() && window.covers().has_end_z_m())
      return ExtentZ{window.covers().begin_z_m(), window.covers().end_z_m()};
  return std::nullopt;
}

}  // namespace teletact::client
