#include "client/render/hold_renderer.h"

#include <algorithm>

namespace teletact::client {

bool HoldRenderer::update(const ForceSample& sample, const ToolPose&, double) noexcept {
  constexpr double kSmallestIndentationM = 1e-6;
  held_ = Rendered();
  surface_m_ = sample.surface_m;
  pressed_ = sample.contact;
  if (!pressed_) return true;
  const double indentation_m = std::max(sample.position_m.y() - sample.surface_m, kSmallestIndentationM);
  const Vector2 stiffness_n_m = -sample.force_n / indentation_m;
  held_.force_n = sample.force_n;
  held_.stiffness_n_m = stiffness_n_m.y();
  held_.lateral_stiffness_n_m = stiffness_n_m.x();
  held_.gain = 1;
  uncertainty_.add(stiffness_n_m, sample.position_m, sample.pose_time_s);
  return true;
}

Rendered HoldRenderer::render(const ToolPose& pose, double time_s, double) noexcept {
  Rendered rendered = held_;
  if (!pressed_) return rendered;
  const Vector2 variance = uncertainty_.at(pose.position_m, time_s);
  rendered.variance = variance.y();
  rendered.lateral_variance = variance.x();
  rendered.stored_j = spring_energy_j(held_.stiffness_n_m, pose.position_m.y() - surface_m_);
  return rendered;
}

}  // namespace teletact::client
