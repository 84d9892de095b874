// A session that was recorded, RF and all, plays again into a service that has never seen it: the same maps,
// the same scene, and the same forces for the same poses.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <memory>

#include "client/session/replay.h"
#include "tests/integration/process.h"
#include "tests/integration/touched_scene.h"

namespace teletact {
namespace {

constexpr const char* kReplayedTissue =
    "seed = 7\n"
    "[tissue]\nwidth_m = 0.12\ndepth_m = 0.03\n"
    "[[inclusion]]\nposition_m = [0.058, 0.011]\ndiameter_m = 0.01\ncontrast = 5.0\n";

// Same device, same order of work: what remains is a restart's rounding, if any.
constexpr double kMapTolerance = 1e-6, kForceToleranceN = 1e-6;

struct Service {
  explicit Service(const std::string& address, const std::string& log)
      : process({test::service_binary(), "serve", "--listen", address}, log) {
    if (!process.says("serving on", 300)) throw std::runtime_error(process.output());
  }
  test::Process process;
};

test::Outcome record_touch(const std::string& address, const test::TemporaryFolder& folder) {
  return test::run({test::client_binary(), "touch", "--service", address, "--scene", "a", "--duration-s", "1",
                    "--renderer", "kalman",  // many answers
                    "--record", folder / "touch.record"},
                   folder / "touch.log");
}

test::Outcome acquire(const std::string& address, const std::string& scene, const std::string& record,
                      const test::TemporaryFolder& folder, const std::vector<std::string>& more) {
  std::vector<std::string> command{test::client_binary(),
                                   "acquire",
                                   "--service",
                                   address,
                                   "--scene",
                                   scene,
                                   "--tissue",
                                   folder / "t.toml",
                                   "--passes-prepared",
                                   "1",
                                   "--modulus-time-limit-s",  // none that a busy machine would feel
                                   "30",
                                   "--duration-s",
                                   "4",
                                   "--record",
                                   record};
  command.insert(command.end(), more.begin(), more.end());
  return test::run(command, folder / "acquire.log", {}, 120);
}

// The same touch with other answers.
void with_answers(const std::string& from, const std::string& to,
                  const std::function<void(v1::TouchAnswer&)>& change) {
  client::RecordReader reader(from);
  client::RecordWriter writer(to, reader.header());
  while (auto entry = reader.next()) {
    if (entry->has_touch_response() && entry->touch_response().has_answer())
      change(*entry->mutable_touch_response()->mutable_answer());
    writer.append_waiting(std::move(*entry));
  }
  writer.close();
}

TEST(Replay, RfRebuildsTheSceneAndTheForcesInAFreshService) {
  test::TemporaryFolder folder;
  const std::string address = "unix:" + (folder / "s");
  std::ofstream(folder / "t.toml") << kReplayedTissue;
  auto service = std::make_unique<Service>(address, folder / "service1.log");
  const test::Outcome acquired = acquire(address, "a", folder / "rf.record", folder, {"--record-rf"});
  ASSERT_EQ(acquired.code, 0) << acquired.output;
  const test::Outcome touched = record_touch(address, folder);
  ASSERT_EQ(touched.code, 0) << touched.output;
  service.reset();  // and with it everything that it knew
  service = std::make_unique<Service>(address, folder / "service2.log");

  const std::atomic<bool> stop{false};
  client::ReplayOptions options;
  options.address = address;
  options.speed = 0;
  options.path = folder / "rf.record";
  const client::ReplayReport maps = client::replay(options, stop);
  EXPECT_EQ(maps.calls, 2u) << "one per window";
  EXPECT_EQ(maps.compared, 2u * 15u + 2u) << "fifteen maps of each pair, and the scene's two";
  EXPECT_EQ(maps.not_alike, 0u);
  EXPECT_LE(maps.largest_map_difference, kMapTolerance) << maps.largest_map;

  options.path = folder / "touch.record";
  const client::ReplayReport forces = client::replay(options, stop);
  EXPECT_GE(forces.compared, 100u);
  EXPECT_EQ(forces.not_alike, 0u);
  EXPECT_LE(forces.largest_force_difference_n, kForceToleranceN);
}

TEST(Replay, ARecordingWithoutRfIsRefusedNotPlayedAsNothing) {
  test::TemporaryFolder folder;
  const std::string address = "unix:" + (folder / "s");
  std::ofstream(folder / "t.toml") << kReplayedTissue;
  const Service service(address, folder / "service.log");
  const test::Outcome acquired = acquire(address, "b", folder / "no-rf.record", folder, {});
  ASSERT_EQ(acquired.code, 0) << acquired.output;
  const test::Outcome replayed =
      test::run({test::client_binary(), "replay", folder / "no-rf.record", "--service", address},
                folder / "replay.log");
  EXPECT_EQ(replayed.code, 1);
  EXPECT_NE(replayed.output.find("--record-rf"), std::string::npos) << replayed.output;
}

// GIVEN a touch recording WHEN it is played where its scene is not, or has nothing to touch THEN that is
// said, no scene is made, and nothing is claimed about its forces.
TEST(Replay, ATouchIsOnlyPlayedIntoASceneThatCanBeTouched) {
  test::TemporaryFolder folder;
  const std::string address = "unix:" + (folder / "s");
  const Service service(address, folder / "service.log");
  test::create_touched_scene(address, "a");
  const test::Outcome touched = record_touch(address, folder);
  ASSERT_EQ(touched.code, 0) << touched.output;
  const auto client = [&](std::vector<std::string> command) {
    command.insert(command.begin(), test::client_binary());
    command.insert(command.end(), {"--service", address});
    return test::run(command, folder / "client.log");
  };
  const auto play = [&] { return client({"replay", folder / "touch.record", "--speed", "0"}); };
  const test::Outcome same = play();
  EXPECT_EQ(same.code, 0) << same.output;
  EXPECT_NE(same.output.find("every force as recorded"), std::string::npos) << same.output;

  ASSERT_EQ(client({"scenes", "--delete", "a"}).code, 0);
  const test::Outcome absent = play();
  EXPECT_EQ(absent.code, 1);
  EXPECT_NE(absent.output.find("no scene 'a' here; publish it first"), std::string::npos) << absent.output;
  EXPECT_EQ(absent.output.find("every force"), std::string::npos) << absent.output;
  EXPECT_NE(client({"scenes"}).output.find("no scenes"), std::string::npos);

  // WHEN the tissue was not covered then and is now THEN no force is like another, and that is no success
  test::create_touched_scene(address, "a");
  const auto play_with = [&](const std::function<void(v1::TouchAnswer&)>& change) {
    with_answers(folder / "touch.record", folder / "other.record", change);
    return client({"replay", folder / "other.record", "--speed", "0"});
  };
  const test::Outcome other = play_with([](v1::TouchAnswer& answer) {
    answer.set_status(v1::TOUCH_STATUS_NOT_COVERED);
    answer.clear_force_n();
  });
  EXPECT_EQ(other.code, 1);
  EXPECT_NE(other.output.find("no force could be compared"), std::string::npos) << other.output;
  EXPECT_NE(other.output.find("of another status or size"), std::string::npos) << other.output;
  EXPECT_EQ(other.output.find("every force"), std::string::npos) << other.output;

  // WHEN what was recorded is no number THEN it is not taken for the same
  const test::Outcome no_number = play_with([](v1::TouchAnswer& answer) {
    for (double& force_n : *answer.mutable_force_n()) force_n = std::nan("");
  });
  EXPECT_EQ(no_number.code, 1);
  EXPECT_EQ(no_number.output.find("every force"), std::string::npos) << no_number.output;
}

}  // namespace
}  // namespace teletact
