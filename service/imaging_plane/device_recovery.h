// A device that fails, and how it comes back: the imaging plane says so, the device is opened anew and warmed
// until that works, and then everything new uses the new one. Answers from compliances go on meanwhile.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

#include "service/imaging_plane/recovery_pauses.h"

namespace teletact::service {

class DeviceRecovery {
 public:
  // `number` is said in the log. `again` opens the device anew, tries it and puts it into use, or throws.
  // `tell` is told each change of whether the device works. Both are called on a thread of its own.
  DeviceRecovery(std::size_t number, std::function<void()> again, std::function<void(bool works)> tell,
                 const RecoveryPauses& = RecoveryPauses());
  ~DeviceRecovery();  // stops
  DeviceRecovery(const DeviceRecovery&) = delete;
  DeviceRecovery& operator=(const DeviceRecovery&) = delete;
  // Waits for a try that is under way; nobody is told anything after it.
  void stop();
  // What failed; returns at once.
  void failed(const std::string& why);
  // Throws Error(kUnavailable) with the remedy while the device does not work.
  void require() const;
  bool works() const;

 private:
  void recover();
  const std::size_t number_;
  const std::function<void()> again_;
  const std::function<void(bool)> tell_;
  RecoveryPauses pauses_;  // of recover()
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::string why_;  // empty: it works
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace teletact::service
