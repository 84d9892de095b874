#include "service/imaging_plane/device_recovery.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <utility>

#include "service/scene/errors.h"

namespace teletact::service {

DeviceRecovery::DeviceRecovery(std::size_t number, std::function<void()> again,
                               std::function<void(bool)> tell, const RecoveryPauses& pauses)
    : number_(number), again_(std::move(again)), tell_(std::move(tell)), pauses_(pauses), thread_([this] {
        recover();
      }) {}

DeviceRecovery::~DeviceRecovery() {
  stop();
}

void DeviceRecovery::stop() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  changed_.notify_all();
  if (thread_.joinable()) thread_.join();
}

void DeviceRecovery::failed(const std::string& why) {
  {
    const std::lock_guard lock(mutex_);
    if (!why_.empty()) return;
    why_ = why.empty() ? "unknown failure" : why;
  }
  spdlog::error("event=device_failed device={} error=\"{}\"", number_, why);
  changed_.notify_all();
}

void DeviceRecovery::require() const {
  const std::lock_guard lock(mutex_);
  if (why_.empty()) return;
  throw Error(ErrorKind::kUnavailable,
              fmt::format("the device failed ({}) and is being reopened; send the pair again once the "
                          "health of teletact.v1.Elastography is SERVING",
                          why_));
}

bool DeviceRecovery::works() const {
  const std::lock_guard lock(mutex_);
  return why_.empty();
}

void DeviceRecovery::recover() {
  using Clock = RecoveryPauses::Clock;
  std::unique_lock lock(mutex_);
  while (!stop_) {
    changed_.wait(lock, [this] { return stop_ || !why_.empty(); });
    if (stop_) return;
    lock.unlock();
    tell_(false);
    lock.lock();
    for (auto pause = pauses_.failed(Clock::now()); !why_.empty(); pause = pauses_.failed_again()) {
      if (changed_.wait_for(lock, pause, [this] { return stop_; })) return;
      lock.unlock();
      std::string still;
      try {
        again_();
      } catch (const std::exception& error) {
        still = error.what();
        spdlog::error("event=device_still_failed device={} error=\"{}\"", number_, still);
      }
      lock.lock();
      why_ = still;
    }
    lock.unlock();
    spdlog::warn("event=device_works_again device={}", number_);
    pauses_.works(Clock::now());
    tell_(true);
    lock.lock();
  }
}

}  // namespace teletact::service
