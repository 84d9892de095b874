// Several devices at once: named one after the other, or parts of one.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "service/device/device.h"

namespace teletact::service {
namespace {

std::string why_refused(const std::vector<std::string>& selections) {
  try {
    choose_devices(selections, {});
  } catch (const DeviceError& error) {
    return error.what();
  }
  return "taken";
}

// Most GPUs cannot: a processor that cannot is a failure.
bool is_gpu() {
  return list_devices().at(0).gpu;
}

// The first device in as many parts as can be.
std::vector<DeviceOptions> cut_finely() {
  return choose_devices({"0/" + std::to_string(std::min(list_devices().at(0).compute_units, 64U))}, {});
}

TEST(ChosenDevices, PartsOfOneAreDevicesOfTheirOwn) {
  if (is_gpu()) GTEST_SKIP() << "most GPUs' drivers cut none";
  const DeviceInfo whole = list_devices().at(0);
  const auto chosen = cut_finely();
  ASSERT_EQ(chosen.size(), std::min(whole.compute_units, 64U));
  std::uint64_t bytes = 0;
  for (std::size_t k = 0; k < chosen.size(); ++k) {
    const auto device = Device::open(chosen[k]);
    EXPECT_GE(device->info().compute_units, 1U);
    EXPECT_LE(device->info().compute_units, (whole.compute_units + chosen.size() - 1) / chosen.size());
    EXPECT_EQ(device->place(), place_of_device(k));
    EXPECT_LE(device->info().max_allocation_bytes, device->info().global_memory_bytes);
    bytes += device->info().global_memory_bytes;
    const std::vector<float> items{1, 2, 3};
    const Queue queue = device->queue();
    EXPECT_EQ(queue.read(queue.array(items)), items);
  }
  EXPECT_LE(bytes, whole.global_memory_bytes);
}

// PoCL 3.1 looks at a part after its last command; one opening in 500 ended the process.
TEST(ChosenDevices, APartIsOpenedAndClosedManyTimes) {
  if (is_gpu()) GTEST_SKIP() << "most GPUs' drivers cut none";
  const auto chosen = cut_finely();
  const std::vector<float> items{1, 2, 3};
  for (int k = 0; k < 2000; ++k) {
    const Queue queue = Device::open(chosen.back())->queue();
    ASSERT_EQ(queue.read(queue.array(items)), items);
  }
}

TEST(ChosenDevices, SelectionsThatCannotBeAreErrorsWithTheRemedy) {
  for (const std::string& parts : {std::string("0"), std::string("65"), std::string(30, '9')}) {
    const std::string why = why_refused({"0/" + parts});
    EXPECT_NE(why.find("is cut into 1 to 64 parts"), std::string::npos) << why;
  }
  DeviceOptions beyond;
  beyond.parts = list_devices().at(0).compute_units + 1;
  EXPECT_THROW(Device::open(beyond), DeviceError);
  for (const char* twice : {"0", ""})
    EXPECT_NE(why_refused({twice, twice}).find("is chosen already"), std::string::npos) << twice;
  EXPECT_NE(why_refused({"0/1", "0"}).find("is chosen already"), std::string::npos);
  EXPECT_NE(why_refused({"0", "none/such"}).find("no OpenCL device matches 'none/such'"), std::string::npos);
}

}  // namespace
}  // namespace teletact::service
