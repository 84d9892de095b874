#include "client/render/renderer.h"

#include <cmath>

namespace teletact::client {

bool is_finite(const ForceSample& sample) noexcept {
  return std::isfinite(sample.pose_time_s) && sample.position_m.allFinite() && sample.force_n.allFinite() &&
         sample.tangent_n_m.allFinite() && sample.surface.normal.allFinite() &&
         std::isfinite(sample.surface.offset_m) && std::isfinite(sample.relative_error);
}

}  // namespace teletact::client
