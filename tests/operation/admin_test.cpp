// What the admin listener says of a service, against what the service was made to do.
#include "service/operation/admin.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "service/device/device.h"
#include "tests/operation/http_peer.h"
#include "tests/operation/metrics.h"
#include "tests/rpc/estimate_client.h"
#include "tests/rpc/two_devices.h"

namespace teletact::service {
namespace {

struct Watched {
  explicit Watched(const Limits& limits = {}, bool ready = true,
                   const std::vector<DeviceOptions>& devices = {})
      : server("", "", limits, tissue_models(), devices),
        admin(listen_for_admin("127.0.0.1:0", server->core())) {
    if (ready) server->make_ready();
  }
  std::string get(const std::string& target) const {
    return test::http_get(test::port_of(admin->address()), target);
  }
  std::map<std::string, double> metrics() const {
    const std::string response = get("/metrics");
    EXPECT_TRUE(response.starts_with("HTTP/1.1 200")) << response;
    return test::metrics_of(response.substr(response.find("\r\n\r\n") + 4));
  }
  // What is counted just after its caller was told of it.
  void expect(const std::string& name, double value) const {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (metrics()[name] != value && std::chrono::steady_clock::now() < end)
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    EXPECT_EQ(metrics()[name], value) << name;
  }
  RunningServer server;
  std::unique_ptr<HttpListener> admin;
};

TEST(Admin, ReadyIsWhoServes) {
  Watched w({}, false);
  EXPECT_TRUE(w.get("/readyz").starts_with("HTTP/1.1 503")) << "it starts";
  EXPECT_TRUE(w.get("/livez").starts_with("HTTP/1.1 200"));
  w.server->make_ready();
  EXPECT_TRUE(w.get("/readyz").starts_with("HTTP/1.1 200"));
  w.server->leave();
  const std::string leaving = w.get("/readyz");
  EXPECT_TRUE(leaving.starts_with("HTTP/1.1 503")) << leaving;
  EXPECT_TRUE(w.server.create(uniform_scene("s")).ok()) << "it still serves";
  w.server->drain();
  const std::string drained = w.get("/readyz");
  EXPECT_TRUE(drained.starts_with("HTTP/1.1 503")) << drained;
  EXPECT_NE(drained.find("shutting down"), std::string::npos) << drained;
  EXPECT_TRUE(w.get("/livez").starts_with("HTTP/1.1 200"));
  EXPECT_GT(w.metrics().size(), 50u) << "figures are there to the last";
}

TEST(Admin, VersionAndWhatThereIs) {
  Watched w;
  EXPECT_NE(w.get("/version").find("\"version\":\"" TELETACT_VERSION "\""), std::string::npos);
  const std::string other = w.get("/");
  EXPECT_TRUE(other.starts_with("HTTP/1.1 404")) << other;
  EXPECT_NE(other.find("/metrics"), std::string::npos) << other;
}

TEST(Admin, TouchesAreCounted) {
  Watched w;
  ASSERT_TRUE(w.server.create(uniform_scene("s")).ok());
  Toucher toucher(w.server.channel(), "s");
  ASSERT_TRUE(toucher.opened());
  w.expect(R"(teletact_calls{kind="touch"})", 1);
  v1::TouchAnswer answer;
  ASSERT_TRUE(toucher.touch(0.05, 0.002, &answer));
  const double preparing = w.metrics()[R"(teletact_touch_answers_total{status="preparing"})"];
  for (int k = 0; k < 10; ++k) ASSERT_TRUE(toucher.touch(0.05, 0.002, &answer));
  for (int k = 0; k < 3; ++k) ASSERT_TRUE(toucher.touch(-1, 0.002, &answer));
  EXPECT_TRUE(toucher.finish().ok());
  w.expect(R"(teletact_touch_answers_total{status="ok"})", 11);
  w.expect(R"(teletact_touch_answers_total{status="not_covered"})", 3);
  w.expect(R"(teletact_calls_ended_total{kind="touch",code="OK"})", 1);
  w.expect(R"(teletact_calls{kind="touch"})", 0);
  const auto m = w.metrics();
  const double all = preparing + 14;
  EXPECT_EQ(m.at("teletact_touch_poses_total"), all);
  EXPECT_EQ(m.at("teletact_touch_poses_replaced_total"), 0);
  for (const char* series :
       {"teletact_touch_pose_age_seconds_count", R"(teletact_touch_stage_seconds_count{stage="queued"})",
        R"(teletact_touch_stage_seconds_count{stage="computed"})"})
    EXPECT_EQ(m.at(series), all) << series;
  EXPECT_NEAR(m.at("teletact_touch_pose_age_seconds_sum"),
              m.at(R"(teletact_touch_stage_seconds_sum{stage="queued"})") +
                  m.at(R"(teletact_touch_stage_seconds_sum{stage="computed"})"),
              1e-9);
  EXPECT_EQ(m.at("teletact_scenes"), 1);
  EXPECT_GT(m.at("process_resident_memory_bytes"), 1e6);
  EXPECT_LT(m.at("process_heap_bytes"), m.at("process_resident_memory_bytes"));
  EXPECT_GT(m.at("process_threads"), 1);
}

TEST(Admin, RefusalsAreCountedByReason) {
  Limits limits;
  limits.max_touch_streams = 2;
  Watched w(limits, false);
  Toucher early(w.server.channel(), "s");
  EXPECT_FALSE(early.opened());
  w.server->make_ready();
  ASSERT_TRUE(w.server.create(uniform_scene("s")).ok());
  Toucher one(w.server.channel(), "s"), two(w.server.channel(), Toucher::open_on("s"), "another client");
  ASSERT_TRUE(one.opened() && two.opened());
  for (int k = 0; k < 3; ++k) {
    Toucher beyond(w.server.channel(), "s");
    EXPECT_FALSE(beyond.opened());
  }
  w.expect(R"(teletact_calls_refused_total{kind="touch",reason="starting"})", 1);
  w.expect(R"(teletact_calls_refused_total{kind="touch",reason="full"})", 3);
  w.expect(R"(teletact_calls_ended_total{kind="touch",code="RESOURCE_EXHAUSTED"})", 3);
  w.expect(R"(teletact_calls{kind="touch"})", 2);
  EXPECT_EQ(w.metrics()[R"(teletact_calls_refused_total{kind="estimate",reason="full"})"], 0);
}

TEST(Admin, EstimatesAreTimedByStageAndBytesSaidByKind) {
  Watched w;
  v1::CreateSceneRequest empty;
  empty.set_scene_id("scene");
  for (const double size_m : {0.1, 0.02}) empty.mutable_geometry()->add_size_m(size_m);
  ASSERT_TRUE(w.server.create(empty).ok());
  const Outcome outcome = estimate(w.server.channel(), acquisition("scene"));
  ASSERT_TRUE(outcome.status.ok()) << outcome.status.error_message();
  w.expect(R"(teletact_calls_ended_total{kind="estimate",code="OK"})", 1);
  const auto m = w.metrics();
  double worked_s = 0;
  for (const char* stage : {"displacement", "strain", "modulus", "publish"}) {
    EXPECT_EQ(m.at(std::string("teletact_estimate_stage_seconds_count{stage=\"") + stage + "\"}"), 1);
    worked_s += m.at(std::string("teletact_estimate_stage_seconds_sum{stage=\"") + stage + "\"}");
  }
  EXPECT_GE(m.at(R"(teletact_imaging_busy_seconds_total{device="0"})"), 0.9 * worked_s);
  double held = 0;
  for (const auto& [series, value] : m)
    if (series.starts_with("teletact_memory_bytes") && series.find("place=\"host\"") != std::string::npos)
      held += value;
  EXPECT_GT(held, 0);
  EXPECT_LT(held, m.at(R"(teletact_memory_limit_bytes{place="host"})"));
}

TEST(Admin, EachDeviceHasFiguresOfItsOwn) {
  Watched w({}, true, two_devices());
  const auto before = w.metrics();
  for (const char* id : {"a", "b"}) {
    v1::CreateSceneRequest empty;
    empty.set_scene_id(id);
    for (const double size_m : {0.1, 0.02}) empty.mutable_geometry()->add_size_m(size_m);
    ASSERT_TRUE(w.server.create(empty).ok());
    ASSERT_TRUE(estimate(w.server.channel(), acquisition(id)).status.ok());
  }
  const auto m = w.metrics();
  for (const char* busy : {R"(teletact_imaging_busy_seconds_total{device="0"})",
                           R"(teletact_imaging_busy_seconds_total{device="1"})"})
    EXPECT_GT(m.at(busy), before.at(busy)) << busy;
  EXPECT_EQ(m.at(R"(teletact_device_works{device="0"})"), 1);
  EXPECT_EQ(m.at(R"(teletact_device_works{device="1"})"), 1);
  EXPECT_EQ(m.at("teletact_scenes_moved_total"), 0);
  for (const char* place : {"device", "device 1"}) {
    const std::string of = std::string("{place=\"") + place + "\"";
    EXPECT_GT(m.at("teletact_memory_bytes" + of + ",kind=\"arrays\"}"), 0);
    EXPECT_GT(m.at("teletact_memory_limit_bytes" + of + "}"), 0);
  }
  fail_launches(true, 1);
  int refused = 0;
  for (const char* id : {"a", "b"}) {
    const grpc::StatusCode code = estimate(w.server.channel(), acquisition(id)).status.error_code();
    refused += code == grpc::StatusCode::UNAVAILABLE ? 1 : 0;
  }
  EXPECT_EQ(refused, 1);
  w.expect(R"(teletact_device_works{device="1"})", 0);
  for (const char* id : {"a", "b"})
    EXPECT_TRUE(estimate(w.server.channel(), acquisition(id)).status.ok()) << id;
  w.expect("teletact_scenes_moved_total", 1);
  EXPECT_EQ(w.metrics().at(R"(teletact_device_works{device="0"})"), 1);
  fail_launches(false);
  w.expect(R"(teletact_device_works{device="1"})", 1);
  for (const auto& [series, value] : w.metrics())
    EXPECT_EQ(series.find("scene=\""), std::string::npos) << series;
}

TEST(Admin, NoSceneSessionOrClientIsALabel) {
  Watched w;
  const auto touch = [&](const std::string& name) {
    ASSERT_TRUE(w.server.create(uniform_scene("scene-" + name), "client-" + name).ok());
    v1::TouchOpen open = Toucher::open_on("scene-" + name);
    open.set_session_id("session-" + name);
    Toucher toucher(w.server.channel(), open, "client-" + name);
    v1::TouchAnswer answer;
    ASSERT_TRUE(toucher.opened() && toucher.touch(0.05, 0.002, &answer));
    EXPECT_TRUE(toucher.finish().ok());
  };
  // Kinds of memory come and go with what is held.
  const auto series = [&](double touches) {
    for (const char* kind : {"touch", "unary"})
      w.expect(std::string("teletact_calls_ended_total{kind=\"") + kind + "\",code=\"OK\"}", touches);
    const auto all = w.metrics();
    return std::count_if(all.begin(), all.end(),
                         [](const auto& m) { return !m.first.starts_with("teletact_memory_bytes"); });
  };
  touch("a");
  const auto of_one = series(1);
  for (const char* name : {"b", "c", "d"}) touch(name);
  EXPECT_EQ(series(4), of_one);
  const std::string text = w.get("/metrics");
  for (const char* word : {"scene-", "session-", "client-"})
    EXPECT_EQ(text.find(word), std::string::npos) << word;
}

}  // namespace
}  // namespace teletact::service
