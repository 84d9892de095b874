#include "bench/stability/renderers.h"

#include <algorithm>

#include "client/render/kalman_renderer.h"
#include "client/render/renderers.h"

namespace teletact::bench {

using client::EnergyLedger;
using client::ForceSample;
using client::Rendered;
using client::ToolPose;
using client::Vector3;

namespace {

// An answer's force, and the spring through it.
Rendered told_by(const ForceSample& sample) noexcept {
  constexpr double kSmallestIndentationM = 1e-6;
  Rendered told;
  if (!sample.contact) return told;
  const double indentation_m = std::max(sample.surface.depth_m(sample.position_m), kSmallestIndentationM);
  const Vector3 stiffness_n_m =
      client::ContactFrame(sample.surface.normal).to_contact(-sample.force_n) / indentation_m;
  told.force_n = sample.force_n;
  told.stiffness_n_m = stiffness_n_m.y();
  told.lateral_stiffness_n_m = client::lateral(stiffness_n_m);
  told.gain = 1;
  return told;
}

// Held by a spring: k d^2 / 2; nothing where it pulls or outside of the tissue.
double spring_energy_j(double stiffness_n_m, double indentation_m) noexcept {
  const double depth_m = std::max(indentation_m, 0.0);
  return std::max(stiffness_n_m, 0.0) * depth_m * depth_m / 2;
}

}  // namespace

const std::vector<std::string>& renderer_names() {
  static const std::vector<std::string> names{"kalman", "kalman-force", "interpolate", "hold"};
  return names;
}

std::unique_ptr<client::Renderer> make_any_renderer(const std::string& name, double servo_period_s,
                                                    const client::ForceLimits& limits) {
  if (name == "interpolate") return std::make_unique<InterpolatingRenderer>();
  if (name == "hold") return std::make_unique<HoldRenderer>();
  if (name != "kalman-force") return client::make_renderer(name, servo_period_s, limits);
  client::KalmanOptions options{.use_tangent = false};
  options.blend.servo_period_s = servo_period_s;
  return std::make_unique<client::KalmanRenderer>(options);
}

bool HoldRenderer::update(const ForceSample& sample, const ToolPose&, double) noexcept {
  held_ = told_by(sample);
  surface_ = sample.surface;
  return true;
}

Rendered HoldRenderer::render(const ToolPose& pose, double, EnergyLedger&) noexcept {
  Rendered rendered = held_;
  rendered.stored_j = spring_energy_j(held_.stiffness_n_m, surface_.depth_m(pose.position_m));
  return rendered;
}

double InterpolatingRenderer::share(double time_s) const noexcept {
  return period_s_ > 0 ? std::clamp((time_s - arrival_s_) / period_s_, 0.0, 1.0) : 1.0;
}

// f = f_1 + (f_2 - f_1) (t - t_2) / T
Rendered InterpolatingRenderer::value(double time_s) const noexcept {
  const double way = share(time_s);
  const auto between = [way](const auto& from, const auto& to) { return (from + way * (to - from)).eval(); };
  Rendered now;
  now.force_n = between(from_.force_n, to_.force_n);
  now.stiffness_n_m = from_.stiffness_n_m + way * (to_.stiffness_n_m - from_.stiffness_n_m);
  now.lateral_stiffness_n_m = between(from_.lateral_stiffness_n_m, to_.lateral_stiffness_n_m);
  return now;
}

bool InterpolatingRenderer::update(const ForceSample& sample, const ToolPose&, double time_s) noexcept {
  // After a pause the next answer is taken to come as soon as any: a longer way would only be older.
  constexpr double kLongestPeriodS = 0.5;
  const Rendered before = value(time_s);
  to_ = told_by(sample);
  surface_ = sample.surface;
  from_ = known_ ? before : to_;
  if (known_) period_s_ = std::clamp(time_s - arrival_s_, 0.0, kLongestPeriodS);
  arrival_s_ = time_s;
  known_ = true;
  return true;
}

Rendered InterpolatingRenderer::render(const ToolPose& pose, double time_s, EnergyLedger&) noexcept {
  Rendered rendered = value(time_s);
  rendered.gain = known_ ? share(time_s) : 0;
  rendered.stored_j = spring_energy_j(rendered.stiffness_n_m, surface_.depth_m(pose.position_m));
  return rendered;
}

}  // namespace teletact::bench
