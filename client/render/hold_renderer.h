// Zero-order hold: the newest streamed force, unchanged until the next. The common peer whose passivity bound
// is T5.1/T5.2; it steps at every update, and lags by the age of the answer.
#pragma once

#include "client/render/held_variance.h"
#include "client/render/renderer.h"

namespace teletact::client {

class HoldRenderer final : public Renderer {
 public:
  void reset() noexcept override { *this = HoldRenderer(); }
  bool update(const ForceSample& sample, const ToolPose& pose, double time_s) noexcept override;
  using Renderer::render;
  Rendered render(const ToolPose& pose, double time_s, EnergyLedger&) noexcept override;

 private:
  Rendered held_;
  TouchedSurface surface_;
  bool pressed_ = false;  // the newest answer had a force
  HeldUncertainty uncertainty_;
};

}  // namespace teletact::client
