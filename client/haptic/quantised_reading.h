// A simulated device's position as a controller gets it: to the device's resolution, its velocity from the
// differences of those through a first-order filter.
#pragma once

#include "client/render/renderer.h"

namespace teletact::client {

// To the nearest multiple of resolution_m; as it is where that is 0.
inline Vector3 quantised(const Vector3& position_m, double resolution_m) noexcept {
  if (resolution_m <= 0) return position_m;
  return (position_m / resolution_m).array().round() * resolution_m;
}

class QuantisedReading {
 public:
  QuantisedReading(double resolution_m, double filter_s) : resolution_m_(resolution_m), filter_s_(filter_s) {}
  // At rest there.
  void restart(const Vector3& position_m) noexcept {
    pose_ = {quantised(position_m, resolution_m_), Vector3::Zero()};
  }
  // elapsed_s > 0 since the last.
  void take(const Vector3& position_m, double elapsed_s) noexcept {
    const Vector3 quantised_m = quantised(position_m, resolution_m_);
    const double weight = elapsed_s / (elapsed_s + filter_s_);
    pose_.velocity_m_s += weight * ((quantised_m - pose_.position_m) / elapsed_s - pose_.velocity_m_s);
    pose_.position_m = quantised_m;
  }
  const ToolPose& pose() const noexcept { return pose_; }

 private:
  double resolution_m_, filter_s_;
  ToolPose pose_;
};

}  // namespace teletact::client
