#include "client/render/interpolating_renderer.h"

#include <algorithm>

namespace teletact::client {

double InterpolatingRenderer::share(double time_s) const noexcept {
  return period_s_ > 0 ? std::clamp((time_s - arrival_s_) / period_s_, 0.0, 1.0) : 1.0;
}

// f = f_1 + (f_2 - f_1) (t - t_2) / T
InterpolatingRenderer::Value InterpolatingRenderer::value(double time_s) const noexcept {
  const double way = share(time_s);
  return {from_.force_n + way * (to_.force_n - from_.force_n),
          from_.stiffness_n_m + way * (to_.stiffness_n_m - from_.stiffness_n_m)};
}

bool InterpolatingRenderer::update(const ForceSample& sample, const ToolPose&, double time_s) noexcept {
  constexpr double kSmallestIndentationM = 1e-6;
  // After a pause the next answer is taken to come as soon as any: a longer way would only be older.
  constexpr double kLongestPeriodS = 0.5;
  const Value before = value(time_s);
  to_ = Value();
  pressed_ = sample.contact;
  surface_ = sample.surface;
  if (pressed_) {
    const double indentation_m = std::max(surface_.depth_m(sample.position_m), kSmallestIndentationM);
    to_ = {sample.force_n, ContactFrame(surface_.normal).to_contact(-sample.force_n) / indentation_m};
    uncertainty_.add(to_.stiffness_n_m, sample.position_m, sample.pose_time_s);
  }
  from_ = known_ ? before : to_;
  if (known_) period_s_ = std::clamp(time_s - arrival_s_, 0.0, kLongestPeriodS);
  arrival_s_ = time_s;
  known_ = true;
  return true;
}

Rendered InterpolatingRenderer::render(const ToolPose& pose, double time_s, EnergyLedger&) noexcept {
  const Value now = value(time_s);
  Rendered rendered;
  rendered.force_n = now.force_n;
  rendered.stiffness_n_m = now.stiffness_n_m.y();
  rendered.lateral_stiffness_n_m = lateral(now.stiffness_n_m);
  rendered.gain = known_ ? share(time_s) : 0;
  rendered.stored_j = spring_energy_j(now.stiffness_n_m.y(), surface_.depth_m(pose.position_m));
  if (!pressed_) return rendered;
  // Off by what the newest answer is, and by what is left of the way to it.
  const Vector3 variance =
      uncertainty_.at(pose.position_m, time_s) + (now.stiffness_n_m - to_.stiffness_n_m).cwiseAbs2();
  rendered.variance = variance.y();
  rendered.lateral_variance = lateral(variance);
  return rendered;
}

}  // namespace teletact::client
