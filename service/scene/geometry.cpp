#include "service/scene/geometry.h"

#include <fmt/format.h>

#include <stdexcept>

namespace teletact::service {

void validate(const SceneGeometry& g, const Limits& limits) {
  require_between("geometry.size_m[0]", g.width_m, limits.min_scene_m, limits.max_scene_width_m,
                  "give the tissue's width in metres");
  require_between("geometry.size_m[1]", g.depth_m, limits.min_scene_m, limits.max_scene_depth_m,
                  "give the tissue's depth in metres");
  if (!(g.poisson_ratio >= 0 && g.poisson_ratio < 0.5))
    throw std::invalid_argument(fmt::format(
        "geometry.poisson_ratio: {} is not within [0, 0.5); soft tissue is about 0.49", g.poisson_ratio));
  require_between("geometry.thickness_m", g.thickness_m, limits.min_thickness_m, limits.max_thickness_m,
                  "give the finger's out-of-plane contact width in metres");
  const Supports& s = g.supports;
  const auto fixed = [](EdgeSupport e) { return e == EdgeSupport::kFixed; };
  if (!fixed(s.top) && !fixed(s.bottom) && !fixed(s.left) && !fixed(s.right))
    throw std::invalid_argument(
        "geometry.supports: no face is held, so the tissue would float away; hold the bottom or another "
        "face");
}

}  // namespace teletact::service
