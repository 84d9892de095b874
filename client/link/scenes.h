// Scenes as a service holds them.
#pragma once

#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include "teletact/v1/palpation.grpc.pb.h"

namespace teletact::client {

// Says in the metadata of a call that it is about this scene, for proxies that choose a node by it. Before
// the call begins; what cannot be a scene's id is left out.
void name_scene(grpc::ClientContext&, const std::string& scene_id);

// GetScene; `within`: its deadline, 0 s for none.
grpc::Status get_scene(v1::Palpation::Stub& stub, const std::string& scene_id, v1::SceneView view,
                       v1::Scene& scene, std::chrono::seconds within = {});

// What a scene is, in a word: "plane", "extruded", "solid"; "tissue" where the service does not say.
const char* kind_of(const v1::Scene& scene);

struct Extent {
  double begin_x_m = 0, end_x_m = 0;
};
// What windows that can be touched cover without a gap, along x.
std::vector<Extent> touchable_extents(const v1::Scene& scene);
// From the first to the last of them; none where there is none.
std::optional<Extent> touchable_extent(const v1::Scene& scene);
// Of a solid, along z; none of a plane scene.
struct ExtentZ {
  double begin_z_m = 0, end_z_m = 0;
};
std::optional<ExtentZ> touchable_extent_z(const v1::Scene& scene);

}  // namespace teletact::client
