// Adapters for makers' libraries, through the plugin and the process that it starts: axes, the watchdog, and
// what is said when a library or a device is not there.
#include <signal.h>
#include <sys/wait.h>

#include <cmath>
#include <filesystem>

#include "tests/files/temporary_folder.h"
#include "tests/haptic/boxed_device.h"

namespace teletact::client {
namespace {

using test::comes;
using test::has_ended;

bool has(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

class BoxedDevices : public test::BoxedTest {
 protected:
  bool read() { return device->read(now_ns += 1'000'000, reading); }
  void open(const std::string& more = "") {
    device = make(more);
    device->open();
    ASSERT_TRUE(comes([&] { return read(); }));
  }
  bool pushes(const Vector3& wanted_n) {
    return comes([&] {
      EXPECT_TRUE(device->write(wanted_n));
      return (force_n() - wanted_n).norm() < 1e-12;
    });
  }
  std::unique_ptr<PluginDevice> device;
  DeviceReading reading;
  std::int64_t now_ns = 1'000'000'000;
};

TEST_P(BoxedDevices, MovesAndPushesAlongTheScenesAxes) {
  open();
  EXPECT_EQ(device->profile().name, GetParam().name);
  EXPECT_GT(device->profile().largest_force_n, 3);
  EXPECT_GE(device->profile().largest_stiffness_n_m, 400);
  EXPECT_GT(device->profile().workspace_radius_m, 0.03);
  EXPECT_EQ(fake->force_enabled, 1);
  EXPECT_EQ(reading.pose.position_m, start_m);
  const auto centre_m = device->workspace_centre_m();
  ASSERT_TRUE(centre_m);
  EXPECT_LE((*centre_m - (start_m - Vector3(0.001, 0.002, 0.003))).norm(), 1e-12);
  put_hand({0.011, -0.018, 0.033}, {0.1, 0.2, -0.3});
  fake->buttons = 2;
  ASSERT_TRUE(comes([&] { return read() && reading.buttons == 2; }));
  ASSERT_TRUE(comes([&] {
    return read() && (reading.pose.position_m - start_m - Vector3(0.01, -0.02, 0.03)).norm() < 1e-12;
  }));
  EXPECT_LE((reading.pose.velocity_m_s - Vector3(0.1, 0.2, -0.3)).norm(), 1e-12);
  EXPECT_FALSE(reading.resume_pressed);
  fake->buttons = 1;
  EXPECT_TRUE(comes([&] { return read() && reading.resume_pressed; }));
  EXPECT_TRUE(pushes({0.3, -1.5, 0.2}));
  // No more than it gives, whatever is asked for.
  EXPECT_TRUE(comes([&] {
    device->write({0, -1000, 0});
    return std::abs(force_n().y() + device->profile().largest_force_n) < 1e-9;
  }));
  device->close();
  EXPECT_EQ(force_n().norm(), 0);
  EXPECT_EQ(fake->force_enabled, 0);
  EXPECT_EQ(fake->opened, fake->closed);
  EXPECT_TRUE(has_ended(fake->box));
}

TEST_P(BoxedDevices, AForceThatNobodyRenewsIsGone) {
  open();
  ASSERT_TRUE(pushes({0, -2, 0}));
  EXPECT_TRUE(comes([&] { return force_n().norm() == 0; })) << "nobody writes";
  ASSERT_TRUE(pushes({0, -2, 0}));
  device->let_go();
  EXPECT_FALSE(device->write({0, -2, 0}));
  EXPECT_TRUE(comes([&] { return force_n().norm() == 0; }));
}

// kill -9: the box outlives the client, and leaves no force.
TEST_P(BoxedDevices, AClientThatIsKilledLeavesNoForce) {
  const pid_t client = ::fork();
  ASSERT_GE(client, 0);
  if (client == 0) {
    const auto held = make();
    held->open();
    while (true) {
      held->write({0, -2, 0});
      ::usleep(500);
    }
  }
  EXPECT_TRUE(comes([&] { return force_n().y() == -2; }));
  ::kill(client, SIGKILL);
  ::waitpid(client, nullptr, 0);
  EXPECT_TRUE(comes([&] { return force_n().norm() == 0; }));
  EXPECT_TRUE(comes([&] { return has_ended(fake->box); }));
  EXPECT_EQ(fake->closed, 1);
}

TEST_P(BoxedDevices, SaysWhatIsWrongAndWhatToDo) {
  const std::string none = complaint("library=/nonexistent.so");
  EXPECT_TRUE(has(none, "/nonexistent.so cannot be loaded") && has(none, "install " + GetParam().sdk) &&
              has(none, "library=PATH"))
      << none;
  const std::string old = complaint(library("old_"));
  EXPECT_TRUE(has(old, "has no function ") && has(old, "give another with library=PATH")) << old;
  EXPECT_TRUE(has(old, GetParam().api == "libdhd" ? "dhdSetForce" : "hdCheckCalibrationStyle")) << old;
  for (const char* wrong : {"spoon", "library=", "library", ",", "force=3"})
    EXPECT_TRUE(has(complaint(wrong), "give library=PATH of " + GetParam().sdk)) << wrong << complaint(wrong);
  fake->mode = FAKE_ABSENT;
  const std::string absent = complaint(library());
  EXPECT_TRUE(has(absent, "no ") && has(absent, "see to its cable and power")) << absent;
  EXPECT_TRUE(has(absent, GetParam().api == "libdhd" ? "no device found" : "timer error (0x0304)")) << absent;
  fake->mode = FAKE_WELL;
  const bool takes_name = GetParam().api == "libhd";
  EXPECT_EQ(complaint(library() + ",device=Left Device").empty(), takes_name);
  EXPECT_TRUE(
      has(complaint(library() + ",device=spoon"), takes_name ? "with the name spoon" : "give library=PATH"));
  const TemporaryFolder alone;
  std::filesystem::copy_file(plugin(), alone / "alone.so");
  PluginDevice without((alone / "alone.so").string(), library(), start_m);
  try {
    without.open();
    ADD_FAILURE() << "opened without its box";
  } catch (const std::runtime_error& error) {
    EXPECT_TRUE(has(error.what(), "teletact-device-box: it has to lie beside the plugin's file"))
        << error.what();
  }
}

TEST_P(BoxedDevices, OneThatIsNotCalibratedHasNoPosition) {
  fake->mode = FAKE_UNCALIBRATED;
  if (GetParam().api == "libdhd") {
    EXPECT_TRUE(has(complaint(library()), "is not calibrated: put it where it rests"));
    return;
  }
  device = make();
  device->open();
  std::string said;
  EXPECT_TRUE(comes([&] {
    EXPECT_FALSE(read());
    return !(said = device->trouble()).empty();
  }));
  EXPECT_TRUE(has(said, "put the stylus into its inkwell")) << said;
  fake->mode = FAKE_WELL;
  EXPECT_TRUE(comes([&] { return read(); }));
}

INSTANTIATE_TEST_SUITE_P(Makers, BoxedDevices, ::testing::ValuesIn(test::makers()),
                         [](const auto& info) { return info.param.plugin; });

}  // namespace
}  // namespace teletact::client
