// Two compute nodes, each behind its own HAProxy, and one before both that spreads scenes: the files of
// packaging/haproxy with this machine's addresses, services and HAProxy as processes.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <fstream>
#include <list>
#include <memory>
#include <regex>
#include <set>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "client/link/channel.h"
#include "client/link/scenes.h"
#include "teletact/v1/info.grpc.pb.h"
#include "tests/integration/process.h"
#include "tests/operation/http_peer.h"
#include "tests/packaging/packaged_file.h"
#include "tests/rpc/running_server.h"
#include "tests/support/certificates.h"

namespace teletact {
namespace {

using namespace std::chrono_literals;
using grpc::StatusCode;
using Replacements = std::vector<std::pair<std::string, std::string>>;

constexpr std::array<const char*, 2> kNodes{"192.0.2.11", "192.0.2.12"};  // as the files have them

// Of this process alone, on any port: `node` 1 and 2.
std::string loopback(std::size_t node) {
  return fmt::format("127.{}.{}.{}", 1 + (getpid() >> 8) % 250, getpid() % 256, node + 10);
}

class ComputeNodes : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(access("/usr/sbin/haproxy", X_OK), 0) << "install it: apt install haproxy";
    std::ofstream(folder_ / "both.pem") << test::kCertificate << test::kCertificateKey;
    std::ofstream(folder_ / "ca.pem") << test::kCertificate;
    for (std::size_t node = 1; node <= 2; ++node) {
      serve(node);
      proxy("node.cfg",
            {{kNodes[0], loopback(node)},
             {"127.0.0.1:", loopback(node) + ":"},
             {"192.0.2.0/24", "127.0.0.0/8"},
             {"/etc/haproxy/teletact.pem", folder_ / "both.pem"}},
            fmt::format("node{}", node));
    }
    proxy("spread.cfg",
          {{kNodes[0], loopback(1)},
           {kNodes[1], loopback(2)},
           {"192.0.2.10:50050", "unix@" + (folder_ / "front")},
           {"node1.example", "localhost"},
           {"node2.example", "localhost"},
           {"/etc/haproxy/teletact.pem", folder_ / "both.pem"},
           {"/etc/haproxy/nodes-ca.pem", folder_ / "ca.pem"}},
          "front");
    for (std::size_t node = 1; node <= 2; ++node)
      ASSERT_TRUE(services_[node - 1]->says("serving on", 300)) << services_[node - 1]->output();
    front_ = client::make_channel("unix:" + (folder_ / "front"), {.tls_ca = test::kCertificate});
    ASSERT_TRUE(within([&] { return answers(front_); })) << said();
  }

  void serve(std::size_t node) {
    services_.at(node - 1) = std::make_unique<test::Process>(
        std::vector<std::string>{test::service_binary(), "serve", "--listen", loopback(node) + ":50051",
                                 "--admin", loopback(node) + ":9464", "--state",
                                 folder_ / fmt::format("state{}", node)},
        folder_ / fmt::format("service{}.log", node));
  }
  void proxy(const std::string& file, Replacements replacements, const std::string& name) {
    std::string text = test::packaged_file("haproxy/" + file);
    replacements.emplace_back("/dev/log local0", "stdout format raw local0");
    for (const auto& [from, to] : replacements) test::replace_all(text, from, to);
    ASSERT_FALSE(std::regex_search(text, std::regex("192\\.0\\.2\\.[0-9]"))) << text;
    std::ofstream(folder_ / (name + ".cfg")) << text;
    proxies_.emplace_back(
        std::vector<std::string>{"/usr/sbin/haproxy", "-db", "-f", folder_ / (name + ".cfg")},
        folder_ / (name + ".log"));
  }
  static bool within(const std::function<bool()>& holds, std::chrono::seconds limit = 60s) {
    const auto end = std::chrono::steady_clock::now() + limit;
    while (!holds()) {
      if (std::chrono::steady_clock::now() > end) return false;
      std::this_thread::sleep_for(20ms);
    }
    return true;
  }
  static bool answers(const std::shared_ptr<grpc::Channel>& channel) {
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + 10s);
    v1::GetInfoResponse info;
    return v1::Info::NewStub(channel)->GetInfo(&context, {}, &info).ok();
  }
  std::string said() const {
    std::string all;
    for (const test::Process& proxy : proxies_) all += proxy.output();
    return all;
  }

  grpc::Status create(const std::string& scene_id) const {
    grpc::ClientContext context;
    client::name_scene(context, scene_id);
    v1::Scene scene;
    return v1::Palpation::NewStub(front_)->CreateScene(&context, service::uniform_scene(scene_id), &scene);
  }
  grpc::Status get(const std::string& scene_id) const {
    v1::Scene scene;
    return client::get_scene(*v1::Palpation::NewStub(front_), scene_id, v1::SCENE_VIEW_BASIC, scene, 10s);
  }
  // Asked of the node itself.
  std::set<std::string> scenes_of(std::size_t node) const {
    const auto channel = client::make_channel(loopback(node) + ":50051");
    grpc::ClientContext context;
    v1::ListScenesResponse scenes;
    EXPECT_TRUE(v1::Palpation::NewStub(channel)->ListScenes(&context, {}, &scenes).ok());
    std::set<std::string> ids;
    for (const v1::Scene& scene : scenes.scenes()) ids.insert(scene.scene_id());
    return ids;
  }

  const test::TemporaryFolder folder_;
  std::array<std::unique_ptr<test::Process>, 2> services_;
  std::list<test::Process> proxies_;
  std::shared_ptr<grpc::Channel> front_;
};

// One after the other, since to set the scene up takes longest.
TEST_F(ComputeNodes, ShareTheScenesAndEachIsFoundWhereItLives) {
  constexpr int kScenes = 16;
  std::set<std::string> made;
  for (int k = 0; k < kScenes; ++k) {
    made.insert(fmt::format("scene-{}", k));
    const grpc::Status status = create(fmt::format("scene-{}", k));
    ASSERT_TRUE(status.ok()) << status.error_message() << said();
  }
  std::array<std::set<std::string>, 2> held{scenes_of(1), scenes_of(2)};
  EXPECT_GE(held[0].size(), 2U);
  EXPECT_GE(held[1].size(), 2U);
  std::set<std::string> both = held[0];
  both.merge(held[1]);
  EXPECT_TRUE(held[1].empty()) << "a scene on two nodes";
  held[1] = scenes_of(2);
  EXPECT_EQ(both, made);
  for (const std::string& id : made) {
    EXPECT_TRUE(get(id).ok()) << id;
    EXPECT_EQ(create(id).error_code(), StatusCode::ALREADY_EXISTS) << id;
  }

  // A touch goes through, and ends with its client's.
  const std::string touched = *held[1].begin();
  {
    grpc::ClientContext context;
    client::name_scene(context, touched);
    const auto stub = v1::Palpation::NewStub(front_);
    const auto stream = stub->Touch(&context);
    v1::TouchRequest request;
    request.mutable_open()->set_scene_id(touched);
    stream->Write(request);
    v1::TouchResponse response;
    ASSERT_TRUE(stream->Read(&response)) << stream->Finish().error_message();
    for (std::uint64_t k = 1; k <= 20; ++k) {
      v1::ContactPose& pose = *request.mutable_pose();
      pose.Clear();
      pose.set_sequence(k), pose.set_acknowledged(response.answer().answer());
      for (const double x_m : {0.05, 0.002, 0.0}) pose.add_position_m(x_m);
      ASSERT_TRUE(stream->Write(request) && stream->Read(&response));
      ASSERT_EQ(response.answer().status(), v1::TOUCH_STATUS_OK) << response.answer().warning();
    }
    EXPECT_TRUE(stream->WritesDone());
    while (stream->Read(&response)) continue;
    EXPECT_TRUE(stream->Finish().ok());
  }
  {  // who names another scene than the message does
    grpc::ClientContext context;
    client::name_scene(context, *held[0].begin());
    v1::GetSceneRequest request;
    request.set_scene_id(touched);
    v1::Scene scene;
    EXPECT_EQ(v1::Palpation::NewStub(front_)->GetScene(&context, request, &scene).error_code(),
              StatusCode::INVALID_ARGUMENT);
  }

  // While node 2 is away its scenes are nowhere else, and nobody else notices.
  services_[1]->kill(SIGTERM);
  ASSERT_EQ(services_[1]->wait(60), 0);
  EXPECT_EQ(get(touched).error_code(), StatusCode::UNAVAILABLE);
  EXPECT_EQ(create(touched).error_code(), StatusCode::UNAVAILABLE);
  for (const std::string& id : scenes_of(1)) EXPECT_TRUE(get(id).ok()) << id;
  EXPECT_TRUE(within([&] {  // once its check has failed
    for (int k = 0; k < 10; ++k)
      if (!answers(front_)) return false;
    return true;
  })) << said();
  serve(2);
  EXPECT_TRUE(within([&] { return get(touched).ok(); }, 300s)) << said();
  EXPECT_EQ(scenes_of(2), held[1]);
}

// What strangers may have of a node.
TEST_F(ComputeNodes, GiveFiguresToWhomTheyNameAndBoundConnections) {
  const auto head = [](std::size_t node, const std::string& path) {
    test::HttpPeer peer(9465, loopback(node).c_str());
    peer.send("GET " + path + " HTTP/1.1\r\nHost: node\r\nConnection: close\r\n\r\n");
    return peer.rest();
  };
  EXPECT_NE(head(1, "/metrics").find("\nteletact_scenes "), std::string::npos);
  EXPECT_EQ(head(2, "/readyz").substr(0, 12), "HTTP/1.1 200");
  EXPECT_EQ(head(2, "/other").substr(0, 12), "HTTP/1.1 403");
  // More than 64 connections of one host are closed at once; another host, as the front is, does not notice.
  constexpr int kMax = 64, kMore = 20;
  std::list<test::HttpPeer> held;
  for (int k = 0; k < kMax + kMore; ++k) held.emplace_back(50052, loopback(1).c_str(), loopback(3).c_str());
  int closed = 0;
  EXPECT_TRUE(within([&] {
    closed += static_cast<int>(held.remove_if([](const test::HttpPeer& peer) { return peer.closed(); }));
    return closed >= kMore;
  })) << closed;
  for (int k = 0; k < 4; ++k)
    EXPECT_TRUE(answers(front_)) << said();  // of either node, over new connections too
}

}  // namespace
}  // namespace teletact
