#include "client/render/hold_renderer.h"

#include <algorithm>

namespace teletact::client {

bool HoldRenderer::update(const ForceSample& sample, const ToolPose&, double) noexcept {
  constexpr double kSmallestIndentationM = 1e-6;
  held_ = Rendered();
  if (!sample.contact) return true;
  const double indentation_m = std::max(sample.position_m.y() - sample.surface_m, kSmallestIndentationM);
  held_.force_n = sample.force_n;
  held_.stiffness_n_m = -sample.force_n.y() / indentation_m;
  held_.gain = 1;
  variance_.add(held_.stiffness_n_m);
  held_.variance = variance_.value();
  return true;
}

Rendered HoldRenderer::render(const ToolPose&, double, double) noexcept {
  return held_;
}

}  // namespace teletact::client
