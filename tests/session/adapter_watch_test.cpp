#include "client/session/adapter_watch.h"

#include <gtest/gtest.h>

#include <utility>

namespace teletact::client {
namespace {

class Adapter final : public HapticDevice {
 public:
  const DeviceProfile& profile() const noexcept override { return device_profile("touch"); }
  void open() override {}
  void close() noexcept override {}
  bool read(std::int64_t, DeviceReading&) noexcept override { return true; }
  bool write(const Vector3&) noexcept override { return true; }
  void let_go() noexcept override { ++let_gos; }
  double longest_call_s() noexcept override { return std::exchange(longest_s, 0); }
  int let_gos = 0;
  double longest_s = 0;
};

TEST(AdapterWatch, ACallThatTakesLongIsSaidAndNotTooOften) {
  Adapter adapter;
  AdapterWatch watch;
  std::uint64_t ticks = 0;
  const auto line_at = [&](double now_s, double longest_s) {
    adapter.longest_s = longest_s;
    return watch.message(adapter, ++ticks, now_s);
  };
  EXPECT_EQ(line_at(1, 0.0009), "");
  EXPECT_NE(line_at(2, 0.012).find("took 12.0 ms"), std::string::npos);
  EXPECT_EQ(line_at(3, 0.030), "");
  EXPECT_EQ(line_at(4, 0), "");
  EXPECT_NE(line_at(2 + AdapterWatch::kEveryS, 0).find("took 30.0 ms"), std::string::npos);
  EXPECT_EQ(line_at(20, 0), "");
  EXPECT_EQ(adapter.let_gos, 0);
  EXPECT_FALSE(watch.stuck());
}

TEST(AdapterWatch, ACallThatDoesNotComeBackIsLetGoOfOnce) {
  // Also the first.
  for (const std::uint64_t blocked_at : {0u, 8u}) {
    Adapter adapter;
    AdapterWatch watch;
    double now_s = 100;
    for (std::uint64_t tick = 0; tick < blocked_at; ++tick, now_s += 0.9)
      EXPECT_EQ(watch.message(adapter, tick, now_s), "");
    const double blocked_s = now_s;
    for (; now_s < blocked_s + 0.97; now_s += 0.02) EXPECT_EQ(watch.message(adapter, blocked_at, now_s), "");
    EXPECT_EQ(adapter.let_gos, 0);
    std::string said;
    for (; said.empty() && now_s < blocked_s + 1.1; now_s += 0.02)
      said = watch.message(adapter, blocked_at, now_s);
    EXPECT_NE(said.find("no tick for 1.0 s"), std::string::npos) << said;
    EXPECT_EQ(adapter.let_gos, 1);
    EXPECT_TRUE(watch.stuck());
    EXPECT_EQ(watch.message(adapter, blocked_at, now_s + 2), "");
    EXPECT_EQ(adapter.let_gos, 1);
  }
}

// Ctrl-Z and fg, or a debugger: nobody looked meanwhile.
TEST(AdapterWatch, AStoppedProcessIsNoAdapterThatDoesNotComeBack) {
  Adapter adapter;
  AdapterWatch watch;
  EXPECT_EQ(watch.message(adapter, 7, 1), "");
  EXPECT_EQ(watch.message(adapter, 7, 61), "");
  EXPECT_EQ(watch.message(adapter, 8, 61.02), "");
  EXPECT_FALSE(watch.stuck());
}

}  // namespace
}  // namespace teletact::client
