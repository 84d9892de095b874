// How often a device is opened anew.
#include "service/imaging_plane/device_recovery.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <future>
#include <thread>
#include <vector>

namespace teletact::service {
namespace {

TEST(DeviceRecovery, ADeviceThatFailsAsSoonAsItIsUsedIsOpenedLessAndLessOften) {
  using Clock = std::chrono::steady_clock;
  constexpr std::chrono::milliseconds kFirst{5};
  constexpr std::size_t kTimes = 5;
  std::vector<Clock::time_point> opened{Clock::now()};  // by one thread, until it is stopped
  std::atomic<std::size_t> times{0};
  std::promise<DeviceRecovery*> used;
  const std::shared_future<DeviceRecovery*> in_use = used.get_future().share();
  DeviceRecovery recovery(
      0,
      [&] {
        opened.push_back(Clock::now());
        ++times;
      },
      [&](bool works) {
        if (works) in_use.get()->failed("in use");
      },
      {kFirst, std::chrono::minutes(10)});
  used.set_value(&recovery);
  recovery.failed("once");
  while (times < kTimes) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  recovery.stop();
  for (std::size_t k = 1; k <= kTimes; ++k)
    EXPECT_GE(opened[k] - opened[k - 1], kFirst * (1 << (k - 1))) << k;
}

}  // namespace
}  // namespace teletact::service
