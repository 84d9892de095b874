// The door to OpenCL: choosing, building, caching, copying, failing with words.
#include "service/device/device.h"
#include "service/base/limits.h"
#include "service/base/memory.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <thread>

#include "service/device/cancellation.h"
#include "service/device/program.h"
#include "tests/support/faulty_kernels.h"

namespace teletact::service {
namespace {

namespace fs = std::filesystem;

constexpr const char* kScale = R"(
#include "factor.clh"
#ifndef SHIFT
#define SHIFT 0
#endif
// y = factor x + SHIFT, one item per entry
kernel void scale(global const real* restrict x, global real* restrict y, const int n, local real* scratch) {
  const int i = get_global_id(0);
  if (i >= n) return;
  y[i] = factor() * x[i] + SHIFT;
}
)";

// Kernels of its own beside the product's, and a cache.
class Device_ : public FaultyKernels {
 protected:
  void SetUp() override {
    FaultyKernels::SetUp();
    put("factor.clh", "real factor() { return 2; }\n");
    put("scale.cl", kScale);
    options_.cache_directory = (folder_ / "cache").string();
  }
  void put(const std::string& name, const std::string& text) { std::ofstream(folder_ / name) << text; }
  std::vector<fs::path> cached() const {
    std::vector<fs::path> files;
    for (const auto& entry : fs::directory_iterator(folder_ / "cache")) files.push_back(entry.path());
    return files;
  }
  template <class T>
  static std::vector<T> scaled(const Device& device, const Defines& defines = {}) {
    const Queue queue = device.queue();
    Kernel kernel = queue.kernel("scale", "scale",
                                 std::is_same_v<T, double> ? Precision::kDouble : Precision::kFloat, defines);
    const auto x = queue.array(std::vector<T>{1, 2, 3, 4, 5});
    auto y = queue.array<T>(5);
    queue.fill_zero(y);
    kernel({{5}, {4}}, x, y, 5, Local{16});
    return queue.read(y);
  }
};

TEST_F(Device_, ListHasTheOpenedDevice) {
  const auto device = Device::open(options_);
  const auto all = list_devices();
  ASSERT_FALSE(all.empty());
  ASSERT_LT(device->info().index, all.size());
  EXPECT_EQ(all[device->info().index].name, device->info().name);
  EXPECT_GT(device->info().max_allocation_bytes, 0u);
}

TEST_F(Device_, IsChosenByIndexAndByPartOfItsName) {
  const std::string name = list_devices().at(0).name;
  options_.select = "0";
  EXPECT_EQ(Device::open(options_)->info().index, 0u);
  options_.select = name.substr(1, 5);
  for (char& c : options_.select) c = static_cast<char>(std::toupper(c));
  EXPECT_NE(Device::open(options_), nullptr);
}

TEST_F(Device_, MissingDeviceIsAnErrorThatListsWhatThereIs) {
  for (const char* select : {"no such device", "17"}) {
    options_.select = select;
    try {
      Device::open(options_);
      FAIL() << "opened";
    } catch (const DeviceError& e) {
      EXPECT_NE(std::string(e.what()).find(select), std::string::npos) << e.what();
      EXPECT_NE(std::string(e.what()).find("[0]"), std::string::npos) << e.what();
    }
  }
}

TEST_F(Device_, KernelRunsInBothPrecisionsPastARaggedEnd) {
  const auto device = Device::open(options_);
  EXPECT_EQ(scaled<float>(*device), (std::vector<float>{2, 4, 6, 8, 10}));
  if (!device->info().has_double) GTEST_SKIP() << "device without double precision";
  EXPECT_EQ(scaled<double>(*device, {{"SHIFT", "3"}}), (std::vector<double>{5, 7, 9, 11, 13}));
}

TEST_F(Device_, SecondOpeningUsesTheDiskCache) {
  scaled<float>(*Device::open(options_));
  ASSERT_EQ(cached().size(), 1u);
  const auto written = fs::last_write_time(cached()[0]);
  EXPECT_EQ(scaled<float>(*Device::open(options_)).at(4), 10.f);
  ASSERT_EQ(cached().size(), 1u);
  EXPECT_EQ(fs::last_write_time(cached()[0]), written);
}

TEST_F(Device_, CorruptCacheEntryIsAMissAndIsReplaced) {
  scaled<float>(*Device::open(options_));
  const fs::path entry = cached().at(0);
  const auto size = fs::file_size(entry);
  fs::resize_file(entry, size / 2);
  EXPECT_EQ(scaled<float>(*Device::open(options_)).at(4), 10.f);
  EXPECT_EQ(fs::file_size(entry), size);
  std::fstream(entry, std::ios::in | std::ios::out | std::ios::binary).seekp(static_cast<long>(size) - 9)
      << "rubbish";
  EXPECT_EQ(scaled<float>(*Device::open(options_)).at(4), 10.f);
}

TEST_F(Device_, ChangedIncludeIsAnotherProgram) {
  EXPECT_EQ(scaled<float>(*Device::open(options_)).at(0), 2.f);
  put("factor.clh", "real factor() { return 7; }\n");
  EXPECT_EQ(scaled<float>(*Device::open(options_)).at(0), 7.f);
  EXPECT_EQ(cached().size(), 2u);
}

TEST_F(Device_, UnwritableCacheOnlyCostsTime) {
  put("cache", "a file where a folder should be");
  EXPECT_EQ(scaled<float>(*Device::open(options_)).at(4), 10.f);
  options_.cache_directory = "none";
  EXPECT_EQ(scaled<float>(*Device::open(options_)).at(4), 10.f);
}

TEST_F(Device_, BuildFailureNamesProgramFileAndReason) {
  put("scale.cl", "kernel void scale(global real* y) { y[0] = nonsense; }\n");
  const Queue queue = Device::open(options_)->queue();
  try {
    queue.kernel("scale", "scale", Precision::kFloat);
    FAIL() << "built";
  } catch (const DeviceError& e) {
    const std::string what = e.what();
    EXPECT_NE(what.find("scale.cl"), std::string::npos) << what;
    EXPECT_NE(what.find("nonsense"), std::string::npos) << what;
    EXPECT_EQ(what.find('\n'), std::string::npos) << what;
  }
  EXPECT_THROW(queue.kernel("absent", "absent", Precision::kFloat), DeviceError);
}

TEST_F(Device_, TooLargeAnArrayIsRefused) {
  const Queue queue = Device::open(options_)->queue();
  EXPECT_THROW(queue.array<double>(std::size_t{1} << 55), DeviceError);
}

TEST_F(Device_, CopiesBeyondTheEndAreRefused) {
  const Queue queue = Device::open(options_)->queue();
  auto a = queue.array(std::vector<int>{1, 2, 3});
  std::vector<int> host(3);
  EXPECT_THROW(queue.read(a, host.data(), 3, 1), DeviceError);
  EXPECT_THROW(queue.write(a, host.data(), 4), DeviceError);
  queue.read(a, host.data(), 2, 1);
  EXPECT_EQ(host, (std::vector<int>{2, 3, 0}));
  auto b = queue.array<int>(3);
  queue.copy(a, b);
  EXPECT_EQ(queue.read(b), (std::vector<int>{1, 2, 3}));
}

TEST_F(Device_, WhatIsSentArrivesInOrderThoughTheHostGoesOn) {
  const Queue queue = Device::open(options_)->queue();
  constexpr int kItems = 1 << 18, kRounds = 9;  // more in all than is kept on its way
  auto a = queue.array<int>(kItems), copies = queue.array<int>(kItems);
  for (int round = 0; round < kRounds; ++round) {
    std::vector<int> host(kItems, round);
    queue.send(a, host.data(), host.size());
    if (round == 3) queue.copy(a, copies);
    std::fill(host.begin(), host.end(), -1);
  }
  const int last[] = {7, 8};
  queue.send(a, last, 2, kItems - 2);
  const std::vector<int> arrived = queue.read(a);
  EXPECT_EQ(arrived.front(), kRounds - 1);
  EXPECT_EQ(arrived[kItems - 3], kRounds - 1);
  EXPECT_EQ(arrived[kItems - 2], 7);
  EXPECT_EQ(arrived.back(), 8);
  EXPECT_EQ(queue.read(copies), std::vector<int>(kItems, 3));
  EXPECT_THROW(queue.send(a, last, 2, kItems - 1), DeviceError);
}

TEST_F(Device_, ManyThreadsBuildAndLaunchTheSameKernel) {
  const auto device = Device::open(options_);
  std::vector<std::vector<float>> answers(4);
  std::vector<std::thread> threads;
  for (auto& answer : answers) threads.emplace_back([&] { answer = scaled<float>(*device); });
  for (auto& thread : threads) thread.join();
  for (const auto& answer : answers) EXPECT_EQ(answer, (std::vector<float>{2, 4, 6, 8, 10}));
}

TEST_F(Device_, ProfileCountsLaunchesByName) {
  options_.profiling = true;
  const Queue queue = Device::open(options_)->queue();
  Kernel kernel = queue.kernel("scale", "scale", Precision::kFloat);
  auto x = queue.array<float>(64), y = queue.array<float>(64);
  for (int i = 0; i < 3; ++i) kernel({{64}, {64}}, x, y, 64, Local{4});
  const auto times = queue.profile();
  ASSERT_EQ(times.size(), 1u);
  EXPECT_EQ(times[0].name, "scale");
  EXPECT_EQ(times[0].launches, 3u);
  EXPECT_GT(times[0].seconds, 0);
}

// Each in a process of its own: the environment must be judged before the first OpenCL call.
void expect_failure_mentions(const char* variable, const std::string& value, const char* mention) {
  setenv(variable, value.c_str(), 1);
  try {
    list_devices();
  } catch (const DeviceError& e) {
    if (std::string(e.what()).find(mention) != std::string::npos) std::exit(42);
  }
  std::exit(1);
}

TEST_F(Device_, UnwritableKernelCacheIsNamedWithItsRemedy) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  put("file", "");
  const std::string blocked = (folder_ / "file" / "cache").string();
  EXPECT_EXIT(expect_failure_mentions("POCL_CACHE_DIR", blocked, "POCL_CACHE_DIR"),
              testing::ExitedWithCode(42), "");
}

TEST_F(Device_, AVariableThatKeepsDriversAwayIsNamed) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const auto check = [this] {
    setenv("OCL_ICD_VENDORS", folder_.c_str(), 1);  // no driver in it
    try {
      Device::open(options_);
    } catch (const DeviceError& e) {
      const std::string named = "no OpenCL device: check or unset OCL_ICD_VENDORS=" + folder_.string();
      if (std::string(e.what()).find(named) != std::string::npos) std::exit(42);
    }
    std::exit(1);
  };
  EXPECT_EXIT(check(), testing::ExitedWithCode(42), "");
}

TEST_F(Device_, WorkersInheritTheNiceValueAndTheCallerKeepsItsOwn) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  const auto check = [this] {
    const int own = getpriority(PRIO_PROCESS, 0);
    options_.niceness = own + 5;
    const auto device = Device::open(options_);
    if (device->info().platform != "Portable Computing Language") std::exit(42);
    std::size_t nice = 0;
    for (const auto& task : fs::directory_iterator("/proc/self/task"))
      nice += getpriority(PRIO_PROCESS, static_cast<id_t>(std::stoi(task.path().filename()))) == own + 5;
    std::exit(getpriority(PRIO_PROCESS, 0) == own && nice >= 1 ? 42 : 1);
  };
  EXPECT_EXIT(check(), testing::ExitedWithCode(42), "");
}

TEST(Program, EveryIncludeAppearsOnce) {
  const std::string source = program_source("empty", [] {
    std::string folder = (fs::temp_directory_path() / "teletact-program-XXXXXX").string();
    EXPECT_NE(mkdtemp(folder.data()), nullptr);
    std::ofstream(folder + "/real.clh") << "typedef float real;\n";
    std::ofstream(folder + "/a.clh") << "int a;\n";
    std::ofstream(folder + "/empty.cl") << "#include \"real.clh\"\n#include \"a.clh\"\n#include \"a.clh\"\n";
    return folder;
  }());
  EXPECT_EQ(source.find("typedef"), source.rfind("typedef"));
  EXPECT_EQ(source.find("int a;"), source.rfind("int a;"));
  EXPECT_NE(source.find("#line 3 \"empty.cl\""), std::string::npos) << source;
}

TEST_F(Device_, SlicedLaunchesGiveTheSame) {
  const auto device = Device::open(options_);
  const Queue queue = device->queue();
  constexpr std::size_t kSize = 1 << 20;
  const Array<float> x = queue.array(std::vector<float>(kSize, 1.5f));
  Array<float> y = queue.array<float>(kSize);
  Kernel scale = queue.kernel("scale", "scale", Precision::kFloat);
  const auto launch = [&] { scale({{kSize}, {64}}, x, y, static_cast<int>(kSize), Local{64}); };
  launch();
  const std::vector<float> whole = queue.read(y);
  for (int again = 0; again < 3; ++again) {
    queue.fill_zero(y);
    int looks = 0;
    {
      const CancellationCheck check([&] { ++looks; });
      launch();
      EXPECT_EQ(queue.read(y), whole);
    }
    if (again == 0) {
      EXPECT_GE(looks, 3);  // not known yet: tried in parts
    }
  }
}

// Bounded in work, whatever the machine does beside it: a size that is not known begins small and grows, none
// is wider than what PoCL compiles once, and a kernel's first launch has been within its range as well as at
// its begin, so that later slices compile nothing.
TEST_F(Device_, SlicesBeginSmallGrowSlowlyAndAreNeverWide) {
  put("where.cl", R"(
kernel void where(global int* restrict size, global int* restrict from) {
  const int i = get_global_id(0);
  size[i] = get_global_size(0);
  from[i] = get_global_offset(0);
}
)");
  const auto device = Device::open(options_);
  const Queue queue = device->queue();
  constexpr int kSize = 1 << 20;
  const Array<int> size = queue.array<int>(kSize), from = queue.array<int>(kSize);
  Kernel where = queue.kernel("where", "where", Precision::kFloat);
  const auto launch = [&](int items) {
    where({{static_cast<std::size_t>(items)}, {64}}, size, from);
    return std::pair{queue.read(size), queue.read(from)};
  };
  EXPECT_EQ(launch(kSize).first.back(), kSize) << "nobody looks: as a whole";
  const CancellationCheck check([] {});
  EXPECT_EQ(launch(128).second[127], 64);
  for (int again = 0; again < 6; ++again) {
    const auto [sizes, begins] = launch(kSize);
    for (int at = 0, before = 4096 / 4; at < kSize; at += sizes[static_cast<std::size_t>(at)]) {
      const auto n = static_cast<std::size_t>(at);
      ASSERT_EQ(begins[n], at);
      ASSERT_LE(sizes[n], 65535);
      if (again < 3) {
        ASSERT_LE(sizes[n], 4 * before) << "not known yet";
      }
      before = sizes[n];
    }
  }
}

TEST_F(Device_, WorkThatIsToEndEndsBetweenTheSlicesOfALaunch) {
  const auto device = Device::open(options_);
  const Queue queue = device->queue();
  constexpr std::size_t kSize = 1 << 20;
  const Array<float> x = queue.array(std::vector<float>(kSize, 1.5f));
  Array<float> y = queue.array<float>(kSize);
  queue.fill_zero(y);
  queue.finish();
  Kernel scale = queue.kernel("scale", "scale", Precision::kFloat);
  {
    const CancellationCheck check([] { throw std::runtime_error("enough"); });
    EXPECT_THROW(scale({{kSize}, {64}}, x, y, static_cast<int>(kSize), Local{64}), std::runtime_error);
  }
  const std::vector<float> part = queue.read(y);
  EXPECT_EQ(part.front(), 3.0f);
  EXPECT_EQ(part.back(), 0.0f);  // never launched
}

// Arrays are charged to who makes them before the device is asked, and returned with them.
TEST(Memory, TooLargeArraysAreNoFailureOfTheDevice) {
  Limits limits;
  limits.host_memory_bytes = 0, limits.device_memory_bytes = 4000, limits.client_memory_share = 0.5;
  const auto budget = std::make_shared<MemoryBudget>(limits);
  const auto device = Device::open();
  const Queue anna = device->queue({budget, "anna", ""}), uncounted = device->queue();
  const std::uint64_t before = device->held_bytes();
  {
    const auto held = anna.array<float>(400);
    EXPECT_EQ(budget->held(Place::kDevice, "anna"), 1600U);
    EXPECT_THROW(anna.array<float>(101), MemoryRefused);
    EXPECT_EQ(device->held_bytes(), before + 1600) << "what was refused was never made";
    const auto beside = uncounted.array<float>(1000);
    anna.charge_to({budget, "berta", ""});
    EXPECT_NO_THROW(anna.array<float>(500)) << "berta's share is her own";
  }
  EXPECT_EQ(budget->held(Place::kDevice), 0U);
  EXPECT_EQ(device->held_bytes(), before);
  DeviceOptions small;
  small.max_array_bytes = 1000;
  EXPECT_THROW(Device::open(small)->queue().array<float>(251), DeviceMemoryError);
}

}  // namespace
}  // namespace teletact::service
