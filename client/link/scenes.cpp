#include "client/link/scenes.h"

#include <algorithm>

namespace teletact::client {

grpc::Status get_scene(v1::Palpation::Stub& stub, const std::string& scene_id, v1::SceneView view,
                       v1::Scene& scene, std::chrono::seconds within) {
  grpc::ClientContext context;
  if (within.count() > 0) context.set_deadline(std::chrono::system_clock::now() + within);
  v1::GetSceneRequest request;
  request.set_scene_id(scene_id);
  request.set_view(view);
  return stub.GetScene(&context, request, &scene);
}

std::optional<Extent> touchable_extent(const v1::Scene& scene) {
  std::optional<Extent> extent;
  for (const v1::Window& window : scene.windows()) {
    if (!window.touchable()) continue;
    const Extent covered{window.covers().begin_x_m(), window.covers().end_x_m()};
    if (!extent) extent = covered;
    extent->begin_x_m = std::min(extent->begin_x_m, covered.begin_x_m);
    extent->end_x_m = std::max(extent->end_x_m, covered.end_x_m);
  }
  return extent;
}

}  // namespace teletact::client
