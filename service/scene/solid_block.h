// The block that a given solid modulus is touched on.
#pragma once

#include "service/contact/solid_touch_model.h"
#include "service/scene/geometry.h"
#include "service/scene/scene_record.h"

namespace teletact::service {

// Columns as they are given, evenly spaced; along z at most choices::kSolidSpacing apart, ln E interpolated
// between the slices, beyond which the outermost go on; rows as they are. Around it, to a power of two of
// columns, the outermost elements go on. Throws std::invalid_argument (field named).
SolidBlock solid_block(const SceneGeometry&, const ExplicitModulus&);
// The same where `before` was one slice less, or had another in this one's place; none: any may be another.
SolidBlock solid_block(const SolidBlock& before, const ExplicitModulus&, std::optional<std::size_t> slice);

}  // namespace teletact::service
