// Linear interpolation between the last two streamed forces (T5.3), the source paper's "common approach":
// when an answer arrives the force starts from where it is and reaches the new one when the next is due. No
// steps, at the price of one period of delay on top of the answer's age.
#pragma once

#include "client/render/held_variance.h"
#include "client/render/renderer.h"

namespace teletact::client {

class InterpolatingRenderer final : public Renderer {
 public:
  void reset() noexcept override { *this = InterpolatingRenderer(); }
  bool update(const ForceSample& sample, const ToolPose& pose, double time_s) noexcept override;
  // The gain is the share of the newest answer in what is rendered: 0 on arrival, 1 a period later.
  using Renderer::render;
  Rendered render(const ToolPose& pose, double time_s, EnergyLedger&) noexcept override;

 private:
  struct Value {
    Vector3 force_n = Vector3::Zero();
    Vector3 stiffness_n_m = Vector3::Zero();  // in the contact
  };
  double share(double time_s) const noexcept;
  Value value(double time_s) const noexcept;

  Value from_, to_;
  HeldUncertainty uncertainty_;
  TouchedSurface surface_;
  bool known_ = false;
  bool pressed_ = false;  // the newest answer had a force
  double arrival_s_ = 0;
  double period_s_ = 0;  // between the last two arrivals
};

}  // namespace teletact::client
