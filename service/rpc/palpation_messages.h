// proto <-> domain for scenes. Everything that comes in is checked before anything is allocated for
// it; std::invalid_argument names the field as the contract does and says what to do.
#pragma once

#include <array>
#include <optional>

#include "service/scene/scene.h"
#include "service/touch_plane/touch_stream.h"
#include "teletact/v1/palpation.pb.h"

namespace teletact::service {

namespace v1 = ::teletact::v1;

SceneGeometry geometry_from(const v1::SceneGeometry&, const Limits&);
// Of the message that scene_to() makes, and what it is made of meanwhile.
std::uint64_t scene_bytes(const Scene&, v1::SceneView);
// `instance`: the process', for stamps.
void scene_to(const Scene&, v1::SceneView, std::uint64_t instance, v1::Scene*);

// CLOCK_MONOTONIC of the process `instance`.
void stamp_to(std::int64_t monotonic_ns, std::uint64_t instance, v1::Stamp*);
void region_to(const Region&, v1::Region*);
void layer_to(const Layer&, v1::Layer*);
// [x, y] or [x, y, z]; what is absent is zero. Throws std::invalid_argument.
std::array<double, 3> vector_from(const char* field, const google::protobuf::RepeatedField<double>&,
                                  bool may_be_empty);

}  // namespace teletact::service
