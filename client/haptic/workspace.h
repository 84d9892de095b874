// Where the device's workspace lies in the scene: axes, scale and clutch between a real device and the servo.
//
// With x the device's position and X the scene's, R a rotation, s the scale and f the scale of force,
//     X = X_0 + s R (x - x_0),   F_device = f R^T F_scene,
// so that a stiffness K of the scene is s f K at the hand, and a joule there is s/f joules of the scene. A
// constant s and f keep a passive scene passive at the hand; what limits it is the device, whose limits are
// stated in the scene's units here: the safety chain above holds them at the hand (decision 0039).
//
// While it is clutched the hand moves and X stands still; x_0 goes with the hand.
#pragma once

#include <atomic>
#include <memory>
#include <string>

#include "client/haptic/freshness_watch.h"
#include "client/haptic/haptic_device.h"
#include "client/haptic/latest_slot.h"

namespace teletact::client {

struct WorkspaceOptions {
  std::string axes = "x,y,z";  // which of the device's move the finger along x, y and z: such as "z,y,-x"
  double rotation_deg = 0;     // the device stands turned by this to the left, seen from above
  double scale = 1;            // metres of the scene per metre of the device, 1 to 20
  double force_scale = 1;      // newtons at the hand per newton of the scene, 0.05 to `scale`
  unsigned clutch_button = 0;  // that clutches while it is down, 1 to 32; 0: none
  bool without_noise = false;  // its positions stand still to the last bit in a hand that does
};

// Throws std::invalid_argument naming the field and what is allowed.
void validate(const WorkspaceOptions&);

// What of the scene is within reach: a ball.
struct Reach {
  Vector3 centre_m = Vector3::Zero();
  double radius_m = 0;
};

class WorkspaceMap {
 public:
  // `start_m`: the point of the scene at which the device's own frame has the same coordinates. Throws as
  // validate().
  WorkspaceMap(const WorkspaceOptions& options, const Vector3& start_m);

  void restart() noexcept;
  // Of the device, to the scene; reading.clutched says whether the hand is clutched now.
  void map(DeviceReading& reading) noexcept;
  Vector3 place_of(const Vector3& device_m) const noexcept;
  Vector3 force_at_hand(const Vector3& scene_n) const noexcept;
  DeviceProfile in_scene(DeviceProfile device) const;

 private:
  Matrix3 turn_;  // R
  double scale_, force_scale_;
  Vector3 start_m_;
  Vector3 device_m_, scene_m_;  // x_0, X_0
  Vector3 unseen_m_ = Vector3::Zero();
  bool clutched_ = false;
};

// A device that a person's hand moves, through a workspace map. All that real devices say passes here, and
// positions that are not of now are marked as frozen.
class WorkspaceDevice final : public HapticDevice {
 public:
  WorkspaceDevice(std::unique_ptr<HapticDevice> device, const WorkspaceOptions& options,
                  const Vector3& start_m);

  const DeviceProfile& profile() const noexcept override { return profile_; }  // after open()
  void open() override;
  void close() noexcept override { device_->close(); }
  bool read(std::int64_t now_ns, DeviceReading& reading) noexcept override;
  bool write(const Vector3& force_n) noexcept override;
  void show_taxels(const TaxelView& view) noexcept override { device_->show_taxels(view); }
  void let_go() noexcept override { device_->let_go(); }
  double longest_call_s() noexcept override { return device_->longest_call_s(); }
  std::string trouble() override;

  // A clutch for devices without buttons, beside the button's. From any thread.
  void toggle_clutch() noexcept { by_key_ = !by_key_; }
  // One reader's: new when the device is first read, and after each clutching. Not of a device that does not
  // state its workspace.
  LatestSlot<Reach>& reach() noexcept { return reach_; }

 private:
  bool is_frozen(std::int64_t now_ns, const DeviceReading& raw) noexcept;

  std::unique_ptr<HapticDevice> device_;
  WorkspaceOptions options_;
  WorkspaceMap map_;
  FreshnessWatch watch_;
  Freshness freshness_ = Freshness::kFresh;
  bool under_force_ = false;
  std::atomic<Freshness> found_{Freshness::kFresh};  // to be said
  DeviceProfile profile_;
  std::atomic<bool> by_key_{false};
  bool reach_due_ = true;
  LatestSlot<Reach> reach_;
};

}  // namespace teletact::client
