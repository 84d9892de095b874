// A device behind the C interface of teletact_device.h, loaded from a shared library.
#pragma once

#include <atomic>
#include <string>

#include "client/clock/clock.h"
#include "client/haptic/anchor.h"
#include "client/haptic/derived_velocity.h"
#include "client/haptic/haptic_device.h"
#include "client/haptic/teletact_device.h"

namespace teletact::client {

class PluginDevice final : public HapticDevice {
 public:
  // Loads `path`; `start_m`: where in the scene the device stands at first. Throws std::runtime_error when
  // there is no such file, it is no device plugin, or it was built for another version of the interface.
  PluginDevice(const std::string& path, std::string settings, const Vector3& start_m);
  ~PluginDevice() override;
  PluginDevice(const PluginDevice&) = delete;
  PluginDevice& operator=(const PluginDevice&) = delete;

  const DeviceProfile& profile() const noexcept override { return profile_; }  // after open()
  void open() override;
  void close() noexcept override;
  bool read(std::int64_t now_ns, DeviceReading& reading) noexcept override;
  bool write(const Vector3& force_n) noexcept override;
  void show_taxels(const TaxelView& view) noexcept override;
  void let_go() noexcept override;
  double longest_call_s() noexcept override { return seconds(longest_ns_.exchange(0)); }
  std::string trouble() override;
  std::optional<Vector3> workspace_centre_m() const noexcept override;

 private:
  template <typename Call>
  int timed(Call&& call) noexcept;
  void check(const teletact_device_limits& limits) const;

  std::string path_, settings_;
  Anchor anchor_;
  DerivedVelocity velocity_;
  void* library_ = nullptr;
  const teletact_device_plugin* plugin_ = nullptr;
  void* device_ = nullptr;  // null: not open
  std::atomic<bool> let_go_{false};
  std::atomic<std::int64_t> longest_ns_{0};
  DeviceProfile profile_;
  Vector3 centre_m_ = Vector3::Zero();  // of its workspace, from the device's own origin
};

}  // namespace teletact::client
