// Whether a scene can be made of an explicit modulus: one that a client gives, or one that was kept on disk.
#pragma once

#include "service/scene/geometry.h"
#include "service/scene/scene_record.h"

namespace teletact::service {

// Of the scene's size: so far nodes may begin and end beside it, by rounding.
constexpr double kNodesSlack = 1e-6;

// Throws std::invalid_argument (field named as in CreateScene), Error(kExhausted) beyond the limits.
void check_modulus(const ExplicitModulus&, const SceneGeometry&, const Limits&);

}  // namespace teletact::service
