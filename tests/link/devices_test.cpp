// Devices as a person chooses them, each through a whole session of touching.
#include "client/link/devices.h"

#include <gtest/gtest.h>

#include <cstdlib>

#include "client/link/touch_session.h"
#include "tests/link/fake_palpation.h"

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

TouchSessionOptions session_options(const std::string& address) {
  TouchSessionOptions options;
  options.address = address;
  options.open.set_scene_id("s");
  options.open.set_period_s(0.002);
  options.open.set_credit(2);
  options.real_time = false;  // not for the threads of a test binary
  return options;
}

TEST(Devices, AreChosenByTheirNamesAndRefusedWithAReason) {
  EXPECT_EQ(complaint("simulated"), "");
  EXPECT_EQ(complaint("inverse3"), "");
  EXPECT_EQ(complaint("inverse3:ws://127.0.0.1:9"), "");
  for (const char* unknown : {"spoon", "", "simulated:x", "plugin:", "plugin", "replay"})
    EXPECT_NE(complaint(unknown).find("known: simulated, plugin:FILE"), std::string::npos) << unknown;
  EXPECT_NE(complaint("plugin:/nonexistent.so,a=b").find("'/nonexistent.so' cannot be loaded"),
            std::string::npos);
  EXPECT_NE(complaint("replay:/nonexistent").find("/nonexistent"), std::string::npos);
  EXPECT_NE(complaint("inverse3:spoon").find("no WebSocket address"), std::string::npos);
}

TEST(Devices, ARecordedMotionIsFeltAgainAndEndsTheSession) {
  FakePalpation service(test::socket_address("again"));
  service.serve();
  TouchSessionOptions options = session_options(test::socket_address("again"));
  options.duration_s = 1.2;
  options.record_path = "/tmp/teletact-motion-" + std::to_string(::getpid());
  const std::atomic<bool> stop{false};
  const TouchSummary recorded = run_touch_session(options, stop);
  // WHEN the motion is done again THEN it ends by itself, after as long, with the same force
  TouchSessionOptions again = session_options(options.address);
  again.device = "replay:" + options.record_path;
  TouchSummary replayed = run_touch_session(again, stop);
  EXPECT_NEAR(replayed.ticks.duration_s(), recorded.ticks.duration_s(), 0.6);
  EXPECT_GT(recorded.ticks.largest_force_n(), 0.3);
  EXPECT_NEAR(replayed.ticks.largest_force_n(), recorded.ticks.largest_force_n(),
              0.1 * recorded.ticks.largest_force_n());
  EXPECT_EQ(replayed.device, "premium-1.5");
  std::remove(options.record_path.c_str());
  EXPECT_NE(complaint(again.device), "");
}

TEST(Devices, APluginIsTouchedWith) {
  const char* folder = std::getenv("TELETACT_BINARY_DIR");
  ASSERT_NE(folder, nullptr) << "run the tests with ctest";
  FakePalpation service(test::socket_address("plugin"));
  service.serve();
  TouchSessionOptions options = session_options(test::socket_address("plugin"));
  options.device = "plugin:" + std::string(folder) + "/client/teletact_device_template.so,stiffness=300";
  std::atomic<bool> stop{false};
  TouchSummary summary;
  std::thread session([&] { summary = run_touch_session(options, stop); });
  // It hovers, and nobody presses its button: answers flow, no force is given.
  EXPECT_TRUE(service.wait_until([](const FakeAccount& account) { return account.answers > 5; }));
  stop = true;
  session.join();
  EXPECT_EQ(summary.device, "template");
  EXPECT_EQ(summary.ticks.largest_force_n(), 0);
  for (const StateChange& change : summary.ticks.changes()) EXPECT_EQ(change.state, ServoState::kDisabled);
}

}  // namespace
}  // namespace teletact::client
