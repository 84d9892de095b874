// The load generator proves itself: a service that stops for two seconds shows in what it says.
#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <thread>

#include "client/link/recording.h"
#include "tests/integration/process.h"
#include "tests/operation/http_peer.h"
#include "tests/operation/metrics.h"

namespace teletact {
namespace {

constexpr double kRecordedHz = 50;

// A finger that goes 40 mm along the middle of the suite's own scene, with laws.
void write_recording(const std::string& path) {
  v1::RecordHeader header;
  header.set_kind("touch");
  header.set_scene_id("bench-load");
  header.set_version(client::kRecordingVersion);
  client::RecordWriter writer(path, header);
  v1::TouchRequest request;
  request.mutable_open()->set_laws(true);
  writer.append_waiting(client::recorded(request, 0, 1));
  for (int k = 0; k < 100; ++k) {
    request.mutable_pose()->Clear();
    for (const double x_m : {0.04 + 4e-4 * k, 0.002, 0.0}) request.mutable_pose()->add_position_m(x_m);
    writer.append_waiting(client::recorded(request, static_cast<std::int64_t>(k * 1e9 / kRecordedHz), 1));
  }
  writer.close();
}

class Load : public testing::Test {
 protected:
  void SetUp() override { ASSERT_TRUE(service_.says("serving on", 300)) << service_.output(); }
  std::vector<std::string> command(std::vector<std::string> more) const {
    std::vector<std::string> out{test::required_environment("TELETACT_BINARY_DIR") + "/bench/teletact-bench",
                                 "load",
                                 "--service",
                                 address_,
                                 "--json",
                                 json_};
    out.insert(out.end(), more.begin(), more.end());
    return out;
  }
  // The suite's own, with touches that check it.
  void make_scene() {
    const auto made = test::run(command({"--duration-s", "0.1"}), folder_ / "made.log", {}, 120);
    ASSERT_EQ(made.code, 0) << made.output;
    std::filesystem::remove(json_);
  }
  nlohmann::json result() const {
    std::ifstream file(json_);
    return nlohmann::json::parse(file);
  }
  std::map<std::string, double> metrics() const {
    test::HttpPeer peer(admin_);
    peer.send("GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n");
    const std::string response = peer.rest();
    return test::metrics_of(response.substr(response.find("\r\n\r\n") + 4));
  }
  nlohmann::json tally() const { return result().at("loads").at(0).at("tally"); }
  // Those that took more than `seconds`, from the buckets as the JSON has them.
  static double over(const nlohmann::json& histogram, double seconds) {
    double n = 0;
    for (const auto& bucket : histogram.at("buckets")) {
      const auto index = bucket.at(0).get<std::uint32_t>();
      const double ns = index < 64 ? index : std::ldexp(64.0 + index % 64, static_cast<int>(index / 64) - 1);
      if (1e-9 * ns > seconds) n += bucket.at(1).get<double>();
    }
    return n;
  }
  const test::TemporaryFolder folder_;
  const std::string address_ = "unix:" + (folder_ / "s"), json_ = folder_ / "load.json";
  const std::string admin_ = folder_ / "a";
  const std::string config_ = [this] {
    std::ofstream(folder_ / "limits.toml") << "[limits]\nmax_touch_streams = 64\n";
    return folder_ / "limits.toml";
  }();
  test::Process service_{{test::service_binary(), "serve", "--listen", address_, "--admin", "unix:" + admin_,
                          "--config", config_},
                         folder_ / "service.log"};
};

TEST_F(Load, AStopOfTheServiceShowsAsItIs) {
  constexpr double kStopS = 2, kRateHz = 50, kClients = 3;
  test::Process load(command({"--clients", "3", "--processes", "2", "--rate-hz", "50", "--duration-s", "8"}),
                     folder_ / "load.log");
  std::this_thread::sleep_for(std::chrono::seconds(5));  // warm-up, and some more
  service_.kill(SIGSTOP);
  std::this_thread::sleep_for(std::chrono::duration<double>(kStopS));
  service_.kill(SIGCONT);
  ASSERT_EQ(load.wait(120), 0) << load.output();
  const auto t = tally();
  EXPECT_NEAR(t.at("intended").get<double>(), 8 * kRateHz * kClients, 0.05 * 8 * kRateHz * kClients);
  EXPECT_GE(t.at("latency").at("max_s").get<double>(), 0.95 * kStopS);
  // Of each client, those meant in the stop's first second waited for more than a second.
  EXPECT_NEAR(over(t.at("latency"), kStopS / 2), kStopS / 2 * kRateHz * kClients,
              0.3 * kStopS * kRateHz * kClients);
  EXPECT_GT(t.at("held_back").get<int>(), 0) << "eight in flight were not enough for two seconds";
  EXPECT_EQ(t.at("opened"), 3);
  EXPECT_TRUE(t.at("failed").empty()) << t;
}

TEST_F(Load, StreamsThatGoAndAreDroppedAreCountedAndLeaveNothing) {
  const auto run = test::run(command({"--clients", "4", "--loop", "poisson", "--rate-hz", "100", "--stay-s",
                                      "0.3", "--cancel-share", "0.5", "--duration-s", "3"}),
                             folder_ / "load.log", {}, 120);
  ASSERT_EQ(run.code, 0) << run.output;
  const auto t = tally();
  EXPECT_GT(t.at("opened").get<int>(), 15) << run.output;
  EXPECT_GT(t.at("cancelled").get<int>(), 3) << run.output;
  EXPECT_TRUE(t.at("failed").empty()) << t;
  EXPECT_TRUE(t.at("refused").empty()) << t;
  EXPECT_EQ(t.at("unanswered"), 0)
      << "what a stream that goes still waits for is not held against the service";
  EXPECT_TRUE(service_.running()) << service_.output();
}

// The service answers a stream every millisecond at most.
TEST_F(Load, CapacityIsThatOfAnswers) {
  const auto run =
      test::run(command({"--clients", "2", "--rate-hz", "250", "--find-capacity", "--latency-limit-s", "10",
                         "--warm-up-s", "0.2", "--duration-s", "1.2"}),
                folder_ / "load.log", {}, 120);
  ASSERT_EQ(run.code, 0) << run.output;
  EXPECT_GT(result().at("capacity_hz").get<double>(), 0) << run.output;
  EXPECT_LE(result().at("capacity_hz").get<double>(), 2100) << run.output;
  EXPECT_GE(result().at("loads").size(), 2u) << run.output;
}

TEST_F(Load, AClosedLoopHasAnAnswerForEachPose) {
  const auto run = test::run(command({"--clients", "3", "--loop", "closed", "--laws", "--duration-s", "1"}),
                             folder_ / "load.log", {}, 120);
  ASSERT_EQ(run.code, 0) << run.output;
  const auto t = tally();
  EXPECT_GT(t.at("intended").get<int>(), 0);
  EXPECT_EQ(t.at("counted_answers"), t.at("intended"));
  EXPECT_EQ(t.at("without_force"), 0);
  EXPECT_GT(t.at("laws").get<int>(), 0);
}

// What the clients counted is what the service did.
TEST_F(Load, TheServiceCountsTheSame) {
  make_scene();
  const auto before = metrics();
  const auto run = test::run(command({"--scene", "bench-load", "--clients", "70", "--processes", "2",
                                      "--rate-hz", "10", "--laws", "--duration-s", "3"}),
                             folder_ / "load.log", {}, 120);
  ASSERT_EQ(run.code, 0) << run.output;
  const auto t = tally();
  const auto after = metrics();
  const auto rose = [&](const std::string& prefix, const std::string& with = "") {
    double sum = 0;
    for (const auto& [series, value] : after)
      if (series.starts_with(prefix) && series.find(with) != std::string::npos)
        sum += value - (before.contains(series) ? before.at(series) : 0);
    return sum;
  };
  const double refused = t.at("refused").at("RESOURCE_EXHAUSTED");
  // Two processes are two clients, who get 43 to 48 places by how their calls come.
  EXPECT_GE(refused, 22);
  EXPECT_LE(refused, 27);
  EXPECT_EQ(over(t.at("refusing"), -1), refused);
  EXPECT_EQ(over(t.at("opening"), -1), 70 - refused);
  EXPECT_EQ(rose(R"(teletact_calls_refused_total{kind="touch",reason="full"})") +
                rose(R"(teletact_calls_refused_total{kind="touch",reason="client_share"})"),
            refused);
  EXPECT_EQ(t.at("opened"), rose(R"(teletact_calls_ended_total{kind="touch",code="OK"})"));
  EXPECT_EQ(t.at("answers"), rose("teletact_touch_answers_total"));
  EXPECT_EQ(t.at("laws"), rose("teletact_touch_law_pieces_total"));
  EXPECT_EQ(t.at("answers"), rose("teletact_touch_poses_total") - rose("teletact_touch_poses_replaced_total"))
      << run.output;
}

TEST_F(Load, ClientsTakeTurnsAmongScenes) {
  const auto run = test::run(command({"--own-scenes", "3", "--clients", "4", "--duration-s", "1"}),
                             folder_ / "load.log", {}, 120);
  ASSERT_EQ(run.code, 0) << run.output;
  EXPECT_EQ(tally().at("opened"), 4);
  EXPECT_EQ(metrics().at("teletact_scenes"), 3);
  for (const char* scene : {"bench-load ", "bench-load-1 ", "bench-load-2 "})
    EXPECT_NE(service_.output().find(std::string("scene=") + scene + "peer"), std::string::npos) << scene;
}

// Beside clients that image: they are said, and their scenes are gone with them.
TEST_F(Load, ARecordedTouchIsDoneByAllBesideImaging) {
  make_scene();
  const std::string recording = folder_ / "touch.rec";
  write_recording(recording);
  const auto run = test::run(command({"--recording", recording, "--clients", "3", "--imaging", "1",
                                      "--image-every-s", "0.5", "--duration-s", "4"}),
                             folder_ / "load.log", {}, 120);
  ASSERT_EQ(run.code, 0) << run.output;
  const auto t = tally();
  EXPECT_NEAR(t.at("intended").get<double>(), 3 * 4 * kRecordedHz, 0.1 * 3 * 4 * kRecordedHz) << run.output;
  EXPECT_EQ(t.at("without_force"), 0) << "all of it lies on the scene";
  EXPECT_GT(t.at("laws").get<int>(), 0) << "as the recorded touch asked for";
  const auto windows = result().at("imaging").at(0);
  EXPECT_GT(windows.at("published").get<int>() + windows.at("late").get<int>(), 0) << run.output;
  EXPECT_EQ(metrics().at("teletact_scenes"), 1) << "but the touched one";
}

TEST_F(Load, WhatContradictsItselfIsRefused) {
  for (const std::vector<std::string>& wrong :
       {std::vector<std::string>{"--find-capacity"},
        {"--find-capacity", "--latency-limit-s", "0.01", "--loop", "closed"},
        {"--loop", "closed", "--ramp-to-hz", "10"},
        {"--rate-hz", "0"},
        {"--clients", "0"},
        {"--cancel-share", "2"},
        {"--recording", "/nowhere"},
        {"--recording", "/nowhere", "--ramp-to-hz", "10"},
        {"--scene", "nobody's"}}) {
    const auto run = test::run(command(wrong), folder_ / "load.log", {}, 60);
    EXPECT_NE(run.code, 0) << wrong.front();
    EXPECT_FALSE(std::filesystem::exists(json_)) << wrong.front();
  }
}

}  // namespace
}  // namespace teletact
