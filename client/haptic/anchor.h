// Where a real device's frame lies in the scene: the point at which it is first read becomes `start_m`. What
// is no number is no point.
#pragma once

#include <optional>

#include "client/render/renderer.h"

namespace teletact::client {

class Anchor {
 public:
  explicit Anchor(const Vector3& start_m) : start_m_(start_m) {}
  void release() noexcept { held_ = false; }
  bool held() const noexcept { return held_; }
  // `device_m` is in metres along the scene's axes, from the device's own origin.
  Vector3 to_scene(const Vector3& device_m) noexcept {
    if (!held_ && device_m.allFinite()) {
      first_m_ = device_m;
      held_ = true;
    }
    return start_m_ + (device_m - first_m_);
  }

  // Where another point of the device's lies, once its frame does.
  std::optional<Vector3> place_of(const Vector3& device_m) const noexcept {
    if (!held_) return std::nullopt;
    return start_m_ + device_m - first_m_;
  }

 private:
  Vector3 start_m_;
  Vector3 first_m_ = Vector3::Zero();
  bool held_ = false;
};

}  // namespace teletact::client
