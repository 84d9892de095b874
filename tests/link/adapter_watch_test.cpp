#include "client/link/adapter_watch.h"

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
  bool write(const Vector2&) noexcept override { return true; }
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
    return watch.line(adapter, ++ticks, now_s);
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
  Adapter adapter;
  AdapterWatch watch;
  EXPECT_EQ(watch.line(adapter, 0, 1), "");  // the servo's thread begins
  EXPECT_EQ(watch.line(adapter, 0, 9), "");
  EXPECT_EQ(watch.line(adapter, 7, 10), "");
  EXPECT_EQ(watch.line(adapter, 7, 10.9), "");
  EXPECT_EQ(watch.line(adapter, 8, 11.1), "");
  EXPECT_EQ(adapter.let_gos, 0);
  EXPECT_NE(watch.line(adapter, 8, 12.2).find("no tick for 1.1 s"), std::string::npos);
  EXPECT_EQ(adapter.let_gos, 1);
  EXPECT_TRUE(watch.stuck());
  EXPECT_EQ(watch.line(adapter, 8, 14), "");
  EXPECT_EQ(adapter.let_gos, 1);
}

}  // namespace
}  // namespace teletact::client
