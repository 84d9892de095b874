// Devices as a person chooses them, each through a whole session of touching.
#include "client/session/devices.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "client/link/recording.h"
#include "client/link/servo_messages.h"
#include "client/session/operator_session.h"
#include "tests/files/temporary_folder.h"
#include "tests/haptic/inverse3_service.h"
#include "tests/link/operator.h"
#include "tests/session/session_options.h"
#include "tests/support/allocation/allocation_count.h"
#include "tests/support/environment.h"
#include "tests/support/kept_log.h"

namespace teletact::client {
namespace {

using test::FakeAccount;
using test::FakePalpation;

std::string complaint(const std::string& device) {
  try {
    make_device({.device = device});
  } catch (const std::exception& error) {
    return error.what();
  }
  return "";
}

// What the servo's thread takes from the heap within its loop, over all sessions of a test.
std::size_t allocations = 0;

OperatorSessionOptions session_options(const std::string& address) {
  allocations = 0;
  OperatorSessionOptions options = test::session_options(address);
  options.servo_begins = [] { teletact::test::count_allocations(true); };
  options.servo_ended = [] {
    teletact::test::count_allocations(false);
    allocations += teletact::test::counted_allocations();
  };
  return options;
}

std::string template_device(const std::string& settings) {
  return "plugin:" + teletact::test::required_environment("TELETACT_BINARY_DIR") +
         "/client/teletact_device_template.so," + settings;
}

TEST(Devices, AreChosenByTheirNamesAndRefusedWithAReason) {
  EXPECT_EQ(complaint("simulated"), "");
  EXPECT_EQ(complaint("simulated-position"), "");
  EXPECT_EQ(complaint("inverse3"), "");
  EXPECT_EQ(complaint("inverse3:ws://127.0.0.1:9"), "");
  for (const char* unknown : {"spoon", "", "simulated:x", "plugin:", "plugin", "replay"})
    EXPECT_NE(complaint(unknown).find("known: simulated, plugin:FILE"), std::string::npos) << unknown;
  EXPECT_NE(complaint("plugin:/nonexistent.so,a=b").find("'/nonexistent.so' cannot be loaded"),
            std::string::npos);
  EXPECT_NE(complaint("replay:/nonexistent").find("/nonexistent"), std::string::npos);
  EXPECT_NE(complaint("inverse3:spoon").find("not a WebSocket address"), std::string::npos);
}

TEST(Devices, ARecordedMotionIsFeltAgainAndEndsTheSession) {
  FakePalpation service(test::socket_address("again"));
  service.serve();
  OperatorSessionOptions options = session_options(test::socket_address("again"));
  options.duration_s = 1.2;
  options.record_path = "/tmp/teletact-motion-" + std::to_string(::getpid());
  const std::atomic<bool> stop{false};
  const TouchSummary recorded = run_operator_session(options, stop);
  // WHEN the motion is done again THEN it ends by itself, after as long, with the same force
  OperatorSessionOptions again = session_options(options.address);
  again.device = "replay:" + options.record_path;
  TouchSummary replayed = run_operator_session(again, stop);
  EXPECT_NEAR(replayed.ticks.duration_s(), recorded.ticks.duration_s(), 0.6);
  EXPECT_GT(recorded.ticks.largest_force_n(), 0.3);
  EXPECT_NEAR(replayed.ticks.largest_force_n(), recorded.ticks.largest_force_n(),
              0.1 * recorded.ticks.largest_force_n());
  EXPECT_EQ(replayed.device, "premium-1.5");
  EXPECT_EQ(allocations, 0u);
  std::remove(options.record_path.c_str());
  EXPECT_NE(complaint(again.device), "");
}

// Before force is on, a hand may stand about for as long as it likes, somewhere else.
TEST(Devices, ARecordedMotionBeginsWhereForceCameOn) {
  const TemporaryFolder folder;
  v1::RecordHeader header;
  header.set_kind("touch");
  RecordWriter writer(folder / "motion", header);
  for (int n = 0; n < 200; ++n) {
    ServoTick tick;
    tick.time_ns = (n + 1) * std::int64_t{1'000'000};
    tick.state = n < 100 ? ServoState::kDisabled : ServoState::kEnabled;
    tick.pose.position_m.x() = n < 100 ? 0.01 : 0.05;
    writer.append_waiting(to_record(tick));
  }
  writer.close();
  const auto device = make_device({.device = "replay:" + (folder / "motion").string()});
  device->open();
  DeviceReading reading;
  ASSERT_TRUE(device->read(1, reading));
  EXPECT_EQ(reading.pose.position_m.x(), 0.05);
}

TEST(Devices, ADisplayThatCommandsAPositionFeelsTheTissue) {
  FakePalpation service(test::socket_address("position"));
  service.serve();
  OperatorSessionOptions options = session_options(test::socket_address("position"));
  options.device = "simulated-position";
  options.duration_s = 0.9;
  const std::atomic<bool> stop{false};
  TouchSummary summary = run_operator_session(options, stop);
  EXPECT_GT(summary.ticks.largest_force_n(), 0.3);
  EXPECT_GT(summary.link.distinct, 100u);
  EXPECT_EQ(summary.ticks.changes().back().reason, StateReason::kDisabledByUser);
  EXPECT_EQ(allocations, 0u);
}

TEST(Devices, APluginIsTouchedWith) {
  FakePalpation service(test::socket_address("plugin"));
  service.windows_m = {{0.058, 0.12}, {0, 0.062}};  // they overlap amid the tissue
  service.serve();
  OperatorSessionOptions options = session_options(test::socket_address("plugin"));
  options.device = template_device("stiffness=300");
  std::atomic<bool> stop{false};
  TouchSummary summary;
  std::thread session([&] { summary = run_operator_session(options, stop); });
  // It hovers, and nobody presses its button: answers flow, no force is given.
  EXPECT_TRUE(service.wait_until([](const FakeAccount& account) { return account.answers > 5; }));
  EXPECT_NEAR(service.account().last_x_m, 0.06, 1e-9) << "amid the tissue, not at its edge";
  stop = true;
  session.join();
  EXPECT_EQ(summary.device, "template");
  EXPECT_EQ(allocations, 0u);
  EXPECT_EQ(summary.ticks.largest_force_n(), 0);
  for (const StateChange& change : summary.ticks.changes()) EXPECT_EQ(change.state, ServoState::kDisabled);
}

// A tactile display is given each image that comes; a device without one is not asked.
TEST(Devices, APluginsDisplayShowsTactileImages) {
  FakePalpation service(test::socket_address("taxels"));
  service.tactile_pa = 1234;
  service.serve();
  const TemporaryFolder folder;
  OperatorSessionOptions options = session_options(test::socket_address("taxels"));
  options.device = template_device("page=" + (folder / "page").string());
  std::atomic<bool> stop{false};
  unsigned elsewhere = 0;
  options.tactile = [&](const TactileImage&) { ++elsewhere; };
  TouchSummary summary;
  std::thread session([&] { summary = run_operator_session(options, stop); });
  EXPECT_TRUE(service.wait_until([](const FakeAccount& account) { return account.answers > 200; }));
  stop = true;
  session.join();
  // As client/haptic/plugins/template.c shares it: motor, 3 counts, command and its time, 6 of motion, its
  // time.
  constexpr std::streamoff kImages = (3 + 3 + 3 + 1 + 6 + 1) * 8;
  std::ifstream page(folder / "page", std::ios::binary);
  page.seekg(kImages);
  std::int64_t images = 0;
  double shown_pa = 0;
  page.read(reinterpret_cast<char*>(&images), sizeof images);
  page.read(reinterpret_cast<char*>(&shown_pa), sizeof shown_pa);
  EXPECT_GT(images, elsewhere);
  EXPECT_LE(images, static_cast<std::int64_t>(summary.link.tactile_images));
  EXPECT_EQ(shown_pa, 1234);
}

// It never says where it is: a button would not help.
TEST(Devices, APluginWithoutAPositionIsToldOfAsADeviceToSeeTo) {
  FakePalpation service(test::socket_address("silent"));
  service.serve();
  OperatorSessionOptions options = session_options(test::socket_address("silent"));
  options.device =
      "plugin:" + teletact::test::required_environment("TELETACT_BINARY_DIR") + "/tests/plugin_silent.so";
  options.still_s = 0.2;
  const teletact::test::KeptLog log;
  std::atomic<bool> stop{false};
  std::thread session([&] { run_operator_session(options, stop); });
  EXPECT_TRUE(log.comes("waiting for the device, which cannot be read or written, or states no position"));
  stop = true;
  session.join();
  EXPECT_TRUE(log.has("the device stands at x = 0.060 m of 0.120 m"));
  EXPECT_FALSE(log.has("button"));
}

TEST(Devices, APluginThatCannotBeLoadedStandsNowhere) {
  FakePalpation service(test::socket_address("nowhere"));
  service.serve();
  OperatorSessionOptions options = session_options(test::socket_address("nowhere"));
  options.device = "plugin:/nonexistent.so";
  const teletact::test::KeptLog log;
  const std::atomic<bool> stop{false};
  EXPECT_THROW(run_operator_session(options, stop), std::runtime_error);
  EXPECT_FALSE(log.has("the device stands"));
}

// What the template says of itself: with a hand in its settings the chain can be seen to work.
TEST(Devices, TheTemplatePressesWhenItIsAskedTo) {
  FakePalpation service(test::socket_address("press"));
  service.serve();
  OperatorSessionOptions options = session_options(test::socket_address("press"));
  const TemporaryFolder folder;
  options.device = template_device("press=0.009,period=1,page=" + (folder / "page").string());
  options.begin_m = 0.05;
  std::atomic<bool> stop{false};
  TouchSummary summary;
  std::thread session([&] { summary = run_operator_session(options, stop); });
  // As client/haptic/plugins/template.c shares it: what the motors give now, up.
  const auto motor_n = [&] {
    double give_n[2] = {0, 0};
    std::ifstream(folder / "page", std::ios::binary).read(reinterpret_cast<char*>(give_n), sizeof give_n);
    return std::hypot(give_n[0], give_n[1]);
  };
  EXPECT_TRUE(test::within(20, [&] { return motor_n() > 0.05; }));  // a press every second
  stop = true;
  session.join();
  EXPECT_GT(summary.ticks.largest_force_n(), 0.05);
}

// Through a workspace map: what is within reach is said, and the key clutches.
TEST(Devices, AScaledDeviceSaysWhatItReachesAndIsClutchedByAKey) {
  FakePalpation service(test::socket_address("scaled"));
  service.serve();
  OperatorSessionOptions options = session_options(test::socket_address("scaled"));
  options.device = template_device("press=0.0045,period=1");
  options.workspace.scale = 2;
  options.begin_m = 0.05;
  const teletact::test::KeptLog log;
  std::atomic<bool> stop{false}, pressed{false};
  options.key = [&] { return pressed.exchange(false) ? 'c' : '\0'; };
  TouchSummary summary;
  std::thread session([&] { summary = run_operator_session(options, stop); });
  EXPECT_TRUE(log.comes("servo ENABLED"));
  EXPECT_TRUE(log.has("1 mm of the device is 2 mm of the scene, 1 N of the tissue is 1 N at the hand"));
  EXPECT_TRUE(log.comes("within reach: x from -0.090 to 0.210 m"));
  pressed = true;
  EXPECT_TRUE(log.comes("servo clutched, the finger stands still at x = 0.060 m"));
  pressed = true;
  EXPECT_TRUE(log.comes("servo no longer clutched"));
  stop = true;
  session.join();
  EXPECT_EQ(allocations, 0u);
}

TEST(Devices, AnInverse3FeelsTheTissue) {
  FakePalpation service(test::socket_address("inverse3"));
  service.serve();
  test::Inverse3Service inverse3;
  inverse3.noise_m = 1e-6;
  inverse3.put_cursor({0, 0, 0.15}, {0, 0, 0});
  OperatorSessionOptions options = session_options(test::socket_address("inverse3"));
  options.device = "inverse3:" + inverse3.url();
  options.start_x_m = 0.008;
  std::atomic<bool> stop{false};
  TouchSummary summary;
  std::thread session([&] { summary = run_operator_session(options, stop); });
  // GIVEN it stands 5 mm above the tissue WHEN its button is pressed and it is pushed down by 9 mm
  EXPECT_TRUE(service.wait_until([](const FakeAccount& account) { return account.answers > 5; }));
  const teletact::test::KeptLog log;
  const auto push_down = [&](int times) {
    inverse3.put_cursor({0, 0, 0.15}, {0, 0, 0});
    inverse3.pressed = true;
    EXPECT_TRUE(log.comes("servo ENABLED", times));
    inverse3.pressed = false;
    for (int k = 1; k <= 90; ++k) {
      inverse3.put_cursor({0, 0, 0.15 - 0.0001 * k}, {0, 0, -0.02});
      std::this_thread::sleep_for(std::chrono::milliseconds(3));
    }
    inverse3.put_cursor({0, 0, 0.141}, {0, 0, 0});
  };
  // THEN it is pushed up by what tissue 4 mm deep pushes with, from when the force has come up on
  const double truth_n = -service.tissue.answer({0.008, 0.004, 0}).force_n.y();
  EXPECT_GT(truth_n, 0.3);
  const auto is_pushed = [&] { return std::abs(inverse3.force_n().z() - truth_n) <= 0.05 * truth_n; };
  const auto stays_pushed = [&] {
    if (!is_pushed()) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    return is_pushed();
  };
  bool felt = false;
  for (int times = 1; times <= 5 && !felt && !HasFailure(); ++times) {  // again after a busy machine's fault
    push_down(times);
    felt = test::within(4, stays_pushed);
  }
  EXPECT_TRUE(felt) << inverse3.force_n().z() << " N instead of " << truth_n;
  stop = true;
  session.join();
  EXPECT_EQ(inverse3.force_n().norm(), 0);
  EXPECT_EQ(summary.device, "inverse3");
  EXPECT_EQ(allocations, 0u);
}

}  // namespace
}  // namespace teletact::client
