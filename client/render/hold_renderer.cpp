#include "client/render/hold_renderer.h"

#include <algorithm>

namespace teletact::client {

bool HoldRenderer::update(const ForceSample& sample, const ToolPose&, double) noexcept {
  constexpr double kSmallestIndentationM = 1e-6;
  held_ = Rendered();
  surface_ = sample.surface;
  pressed_ = sample.contact;
  if (!pressed_) return true;
  const double indentation_m = std::max(surface_.depth_m(sample.position_m), kSmallestIndentationM);
  const Vector3 stiffness_n_m = ContactFrame(surface_.normal).to_contact(-sample.force_n) / indentation_m;
  held_.force_n = sample.force_n;
  held_.stiffness_n_m = stiffness_n_m.y();
  held_.lateral_stiffness_n_m = lateral(stiffness_n_m);
  held_.gain = 1;
  uncertainty_.add(stiffness_n_m, sample.position_m, sample.pose_time_s);
  return true;
}

Rendered HoldRenderer::render(const ToolPose& pose, double time_s, EnergyLedger&) noexcept {
  Rendered rendered = held_;
  if (!pressed_) return rendered;
  const Vector3 variance = uncertainty_.at(pose.position_m, time_s);
  rendered.variance = variance.y();
  rendered.lateral_variance = lateral(variance);
  rendered.stored_j = spring_energy_j(held_.stiffness_n_m, surface_.depth_m(pose.position_m));
  return rendered;
}

}  // namespace teletact::client
