// A device that fails, and how it comes back: the imaging plane says so, the device is opened anew and warmed
// until that works, and then everything new uses the new one. Answers from compliances go on meanwhile.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "service/device/device.h"

namespace teletact::service {

// The device that is used now, and who sees to it when it fails. Thread-safe.
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

class DeviceRecovery {
 public:
  // Between tries: twice as long each time, until the device has worked for longer than the longest.
  static constexpr std::chrono::milliseconds kFirstPause{250}, kLongestPause{30'000};
  // `again` opens the device anew, tries it and puts it into use, or throws. `tell` is told each change of
  // whether the device works. Both are called on a thread of its own.
  DeviceRecovery(std::function<void()> again, std::function<void(bool works)> tell);
  ~DeviceRecovery();  // stops
  DeviceRecovery(const DeviceRecovery&) = delete;
  DeviceRecovery& operator=(const DeviceRecovery&) = delete;
  // Waits for a try that is under way; nobody is told anything after it.
  void stop();
  // What failed; returns at once.
  void failed(const std::string& why);
  // Throws Error(kUnavailable) with the remedy while the device does not work.
  void require() const;

 private:
  void recover();
  const std::function<void()> again_;
  const std::function<void(bool)> tell_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::string why_;  // empty: it works
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace teletact::service
