// How often a device is opened anew.
#include "service/imaging_plane/device_recovery.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <future>
#include <stdexcept>
#include <thread>
#include <vector>

namespace teletact::service {
namespace {

using std::chrono::milliseconds;

TEST(RecoveryPauses, DoubleUpToTheLongest) {
  RecoveryPauses pauses;
  EXPECT_EQ(pauses.failed(RecoveryPauses::Clock::now()), milliseconds(250));
  for (const int ms : {500, 1000, 2000, 4000, 8000, 16'000, 30'000, 30'000})
    EXPECT_EQ(pauses.failed_again(), milliseconds(ms));
}

// The first pauses of a device that works for so long each time.
std::vector<int> first_pauses(milliseconds works) {
  RecoveryPauses pauses;
  RecoveryPauses::Clock::time_point now(std::chrono::hours(1));
  std::vector<int> all;
  for (int k = 0; k < 9; ++k) {
    all.push_back(int(pauses.failed(now).count()));
    pauses.failed_again();
    pauses.works(now);
    now += works;
  }
  return all;
}

TEST(RecoveryPauses, BeginLongerWhereTheDeviceHardlyWorked) {
  const std::vector<int> longer{250, 500, 1000, 2000, 4000, 8000, 16'000, 30'000, 30'000};
  EXPECT_EQ(first_pauses(milliseconds(0)), longer);
  EXPECT_EQ(first_pauses(milliseconds(29'999)), longer);
  EXPECT_EQ(first_pauses(milliseconds(30'000)), std::vector<int>(9, 250));
}

TEST(DeviceRecovery, DeviceThatKeepsFailingIsOpenedLessOften) {
  using Clock = std::chrono::steady_clock;
  constexpr milliseconds kFirst{5};
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
      RecoveryPauses(kFirst, std::chrono::minutes(10)));
  used.set_value(&recovery);
  recovery.failed("once");
  while (times < kTimes) std::this_thread::sleep_for(milliseconds(1));
  recovery.stop();
  for (std::size_t k = 1; k <= kTimes; ++k)
    EXPECT_GE(opened[k] - opened[k - 1], kFirst * (1 << (k - 1))) << k;
}

TEST(DeviceRecovery, DeviceThatDoesNotOpenIsTriedLessOften) {
  using Clock = RecoveryPauses::Clock;
  constexpr milliseconds kFirst{5};
  constexpr std::size_t kTimes = 4;
  std::vector<Clock::time_point> tried;  // by one thread, until it works
  std::promise<void> works_again;
  DeviceRecovery recovery(
      0,
      [&] {
        tried.push_back(Clock::now());
        if (tried.size() < kTimes) throw std::runtime_error("not yet");
      },
      [&](bool works) {
        if (works) works_again.set_value();
      },
      RecoveryPauses(kFirst, std::chrono::minutes(10)));
  recovery.failed("once");
  works_again.get_future().wait();
  recovery.stop();
  for (std::size_t k = 1; k < kTimes; ++k) EXPECT_GE(tried[k] - tried[k - 1], kFirst * (1 << k)) << k;
}

}  // namespace
}  // namespace teletact::service
