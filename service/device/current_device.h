// The device that is used now, and who sees to it when it fails. Thread-safe.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <utility>

#include "service/device/device.h"

namespace teletact::service {

class CurrentDevice {
 public:
  explicit CurrentDevice(std::shared_ptr<Device> device) : device_(std::move(device)) {}
  // Said once, before anything uses it. `see_to_it` is told why, on the thread that met the failure, and must
  // not wait.
  void on_failure(std::function<void(const std::string& why)> see_to_it) {
    see_to_it_ = std::move(see_to_it);
  }
  // `device` failed. Does nothing when another is in use by now.
  void failed(const std::shared_ptr<Device>& device, const std::string& why) const {
    {
      const std::lock_guard lock(mutex_);
      if (device != device_) return;
    }
    if (see_to_it_) see_to_it_(why);
  }
  operator std::shared_ptr<Device>() const {
    const std::lock_guard lock(mutex_);
    return device_;
  }
  std::shared_ptr<Device> operator->() const { return *this; }
  void replace(std::shared_ptr<Device> device) {
    const std::lock_guard lock(mutex_);
    device_.swap(device);
  }

 private:
  std::function<void(const std::string&)> see_to_it_;
  mutable std::mutex mutex_;
  std::shared_ptr<Device> device_;
};

}  // namespace teletact::service
