#include "client/haptic/plugin_device.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <memory>
#include <thread>

namespace teletact::client {
namespace {

std::string built(const std::string& file) {
  const char* folder = std::getenv("TELETACT_BINARY_DIR");
  if (folder == nullptr) throw std::runtime_error("TELETACT_BINARY_DIR is not set; run the tests with ctest");
  return std::string(folder) + "/" + file;
}
const std::string kTemplate = "client/teletact_device_template.so";

// What loading and opening it says; empty when it works.
std::string complaint(const std::string& path, const std::string& settings = "") {
  try {
    PluginDevice device(path, settings, Vector3::Zero());
    device.open();
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

bool within(double seconds, const std::function<bool()>& met) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
  while (!met()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}

TEST(PluginDevice, TheTemplateIsOpenedReadWrittenAndClosed) {
  PluginDevice device(built(kTemplate), "stiffness=100", {0.03, -0.005, 0.002});
  DeviceReading reading;
  EXPECT_FALSE(device.read(1, reading)) << "read before it was opened";
  EXPECT_FALSE(device.write({0, 0, 0}));
  device.open();
  EXPECT_EQ(device.profile().name, "template");
  EXPECT_EQ(device.profile().largest_force_n, 3.3);
  EXPECT_GT(device.profile().limits().largest_slew_n_s, 0);
  EXPECT_EQ(device.profile().limits().damping_n_s_m, 5);
  std::int64_t now_ns = 1'000'000'000;
  // GIVEN where it stands at first THEN that is the start above the tissue
  ASSERT_TRUE(device.read(now_ns, reading));
  EXPECT_EQ(reading.pose.position_m, Vector3(0.03, -0.005, 0.002));
  // WHEN it is pushed by 1 N down and 0.5 N away THEN its spring of 100 N/m gives way by 10 mm and 5 mm
  EXPECT_TRUE(within(30, [&] {
    EXPECT_TRUE(device.write({0, 1.0, 0.5}));
    EXPECT_TRUE(device.read(now_ns += 1'000'000, reading));
    return std::abs(reading.pose.position_m.y() - (-0.005 + 0.010)) < 1e-5 &&
           reading.pose.velocity_m_s.norm() < 1e-4;
  })) << reading.pose.position_m.y();
  EXPECT_NEAR(reading.pose.position_m.x(), 0.03, 1e-9);
  EXPECT_NEAR(reading.pose.position_m.z(), 0.002 + 0.005, 1e-5);
  EXPECT_FALSE(device.write({std::nan(""), 0, 0}));
  // WHEN nobody writes any more THEN it lets go by itself
  EXPECT_TRUE(within(30, [&] {
    EXPECT_TRUE(device.read(now_ns += 1'000'000, reading));
    return reading.pose.position_m.y() < 0;
  }));
  // Opened again it starts from where it stands then.
  device.open();
  ASSERT_TRUE(device.read(now_ns, reading));
  EXPECT_EQ(reading.pose.position_m, Vector3(0.03, -0.005, 0.002));
  device.close();
  EXPECT_FALSE(device.read(now_ns, reading));
}

TEST(PluginDevice, HavingLetGoItTakesNoForceUntilItIsOpenedAgain) {
  PluginDevice device(built(kTemplate), "", {0, 0, 0});
  device.let_go();  // not open: nothing to do
  device.open();
  EXPECT_TRUE(device.write({0, 1, 0}));
  device.let_go();
  EXPECT_FALSE(device.write({0, 1, 0}));
  DeviceReading reading;
  EXPECT_TRUE(device.read(1, reading));
  device.open();
  EXPECT_TRUE(device.write({0, 1, 0}));
}

TEST(PluginDevice, SaysWhatIsWrong) {
  EXPECT_EQ(complaint(built(kTemplate)), "");
  EXPECT_NE(complaint("/nonexistent/device.so").find("'/nonexistent/device.so' cannot be loaded"),
            std::string::npos);
  const std::string text_file = "/tmp/teletact-no-library-" + std::to_string(::getpid());
  std::ofstream(text_file) << "no library";
  EXPECT_NE(complaint(text_file).find("cannot be loaded"), std::string::npos);
  std::remove(text_file.c_str());
  EXPECT_NE(complaint(built("tests/plugin_no_symbol.so")).find("does not export teletact_device_plugin_get"),
            std::string::npos);
  const std::string old = complaint(built("tests/plugin_old_abi.so"));
  EXPECT_NE(old.find("was built for version " + std::to_string(TELETACT_DEVICE_ABI + 7)), std::string::npos)
      << old;
  EXPECT_NE(old.find("build it again"), std::string::npos) << old;
  EXPECT_NE(complaint(built("tests/plugin_no_limits.so")).find("limits.largest_force_n"), std::string::npos);
  EXPECT_NE(complaint(built("tests/plugin_bad_damping.so")).find("limits.damping_n_s_m is -1"),
            std::string::npos);
  for (const char* wrong :
       {"stiffness=-3", "spoon", "stiffness=100,press=1", "press=nan", "press=0.01,period=0"})
    EXPECT_NE(complaint(built(kTemplate), wrong).find("give stiffness=N/m"), std::string::npos) << wrong;
  EXPECT_EQ(complaint(built(kTemplate), "stiffness=100,press=0.01"), "");
}

}  // namespace
}  // namespace teletact::client
