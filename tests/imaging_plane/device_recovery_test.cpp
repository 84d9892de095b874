// How often a device is opened anew.
#include "service/imaging_plane/device_recovery.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <thread>

namespace teletact::service {
namespace {

TEST(DeviceRecovery, ADeviceThatFailsAsSoonAsItIsUsedIsOpenedLessAndLessOften) {
  std::atomic<int> opened{0};
  std::atomic<DeviceRecovery*> used{nullptr};
  DeviceRecovery recovery(
      0, [&] { ++opened; },
      [&](bool works) {
        if (works) used.load()->failed("in use");
      });
  used = &recovery;
  recovery.failed("once");
  std::this_thread::sleep_for(std::chrono::seconds(3));
  recovery.stop();
  EXPECT_GE(opened, 2);
  EXPECT_LE(opened, 3);  // after 0.25, 0.75 and 1.75 s
}

}  // namespace
}  // namespace teletact::service
