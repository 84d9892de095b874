// Renderers that the product's are compared with, by name beside those.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "client/render/force_limits.h"
#include "client/render/renderer.h"

namespace teletact::bench {

// That render what answers tell: the product's kalman, kalman-force (its filter on force alone, the source
// paper's), interpolate and hold.
const std::vector<std::string>& renderer_names();
// One of these, or law. Throws std::invalid_argument. `limits`: of the display.
std::unique_ptr<client::Renderer> make_any_renderer(const std::string& name, double servo_period_s,
                                                    const client::ForceLimits& limits = {});

// Zero-order hold: the newest streamed force, unchanged until the next. The common peer whose passivity bound
// is T5.1/T5.2; it steps at every update, and lags by the age of the answer.
class HoldRenderer final : public client::Renderer {
 public:
  void reset() noexcept override { *this = HoldRenderer(); }
  bool update(const client::ForceSample& sample, const client::ToolPose& pose,
              double time_s) noexcept override;
  using Renderer::render;
  client::Rendered render(const client::ToolPose& pose, double time_s,
                          client::EnergyLedger&) noexcept override;

 private:
  client::Rendered held_;
  client::TouchedSurface surface_;
};

// Linear interpolation between the last two streamed forces (T5.3), the source paper's "common approach":
// when an answer arrives the force starts from where it is and reaches the new one when the next is due. No
// steps, at the price of one period of delay on top of the answer's age.
class InterpolatingRenderer final : public client::Renderer {
 public:
  void reset() noexcept override { *this = InterpolatingRenderer(); }
  bool update(const client::ForceSample& sample, const client::ToolPose& pose,
              double time_s) noexcept override;
  // The gain is the share of the newest answer in what is rendered: 0 on arrival, 1 a period later.
  using Renderer::render;
  client::Rendered render(const client::ToolPose& pose, double time_s,
                          client::EnergyLedger&) noexcept override;

 private:
  double share(double time_s) const noexcept;
  client::Rendered value(double time_s) const noexcept;

  client::Rendered from_, to_;
  client::TouchedSurface surface_;
  bool known_ = false;
  double arrival_s_ = 0;
  double period_s_ = 0;  // between the last two arrivals
};

}  // namespace teletact::bench
