// The Grafana dashboard asks for figures that the service has.
#include <gtest/gtest.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <string>

#include "client/link/channel.h"
#include "tests/integration/process.h"
#include "tests/operation/http_peer.h"
#include "tests/packaging/packaged_file.h"
#include "tests/rpc/running_server.h"

namespace teletact {
namespace {

TEST(Dashboard, AsksForFiguresThatAreThere) {
  const test::TemporaryFolder folder;
  test::Process service({test::service_binary(), "serve", "--listen", "unix:" + (folder / "s"), "--admin",
                         "unix:" + (folder / "a")},
                        folder / "log");
  ASSERT_TRUE(service.says("metrics and health on", 300)) << service.output();
  v1::Scene scene;  // and so memory, and a call that has ended
  grpc::ClientContext context;
  ASSERT_TRUE(v1::Palpation::NewStub(client::make_channel("unix:" + (folder / "s")))
                  ->CreateScene(&context, service::uniform_scene("s"), &scene)
                  .ok());
  std::string metrics;  // the call's end is counted once gRPC is done with it
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (metrics.find("teletact_calls_ended_total{") == std::string::npos &&
         std::chrono::steady_clock::now() < until) {
    test::HttpPeer peer(folder / "a");
    peer.send("GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n");
    metrics = peer.rest();
  }
  const auto dashboard = nlohmann::json::parse(test::packaged_file("prometheus/dashboard.json"));
  static const std::regex kMetric("(teletact|process)_[a-z_]+");
  std::set<std::string> asked;
  for (const auto& panel : dashboard.at("panels"))
    for (const auto& target : panel.at("targets")) {
      const auto expression = target.at("expr").get<std::string>();
      const std::sregex_iterator found(expression.begin(), expression.end(), kMetric);
      ASSERT_NE(found, std::sregex_iterator()) << expression;
      asked.insert(found->str());
    }
  EXPECT_GE(asked.size(), 15U);
  for (const std::string& metric : asked)
    EXPECT_TRUE(std::regex_search(metrics, std::regex("\n" + metric + "[ {]"))) << metric;
}

}  // namespace
}  // namespace teletact
