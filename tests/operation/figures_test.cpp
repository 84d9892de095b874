// Figures whose size is known.
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>
#include <thread>
#include <vector>

#include "service/operation/admin.h"
#include "service/operation/http_listener.h"
#include "tests/operation/http_peer.h"
#include "tests/operation/metrics.h"
#include "tests/rpc/running_server.h"

namespace teletact::service {
namespace {

TEST(Figures, MemoryIsWhatIsResidentAndEachPlaceHasItsLimit) {
  Limits limits;
  limits.host_memory_bytes = std::uint64_t{2} << 30;
  limits.device_memory_bytes = 123U << 20;
  RunningServer server("", "", limits);
  const auto figures = test::metrics_of(metrics_text(server->core()));
  rusage used{};
  getrusage(RUSAGE_SELF, &used);
  EXPECT_LE(figures.at("process_resident_memory_bytes"), 1.1 * 1024 * static_cast<double>(used.ru_maxrss));
  EXPECT_EQ(figures.at(R"(teletact_memory_limit_bytes{place="device"})"), 123U << 20);
  EXPECT_EQ(figures.at(R"(teletact_memory_limit_bytes{place="host"})"),
            static_cast<double>(limits.host_memory_bytes));
}

TEST(HttpListener, SilentPeersAreClosed) {
  constexpr double kPatienceS = 0.05;
  const HttpListener listener(
      "--admin", "127.0.0.1:0", [](const std::string&) { return HttpListener::Answer{}; }, kPatienceS);
  std::vector<test::HttpPeer> silent;
  for (std::size_t k = 0; k < HttpListener::kMaxConnections; ++k)
    silent.emplace_back(test::port_of(listener.address()));
  const auto give_up = std::chrono::steady_clock::now() + std::chrono::seconds(10);
  for (const test::HttpPeer& peer : silent)
    while (!peer.closed() && std::chrono::steady_clock::now() < give_up) std::this_thread::yield();
  for (const test::HttpPeer& peer : silent) EXPECT_TRUE(peer.closed());
}

}  // namespace
}  // namespace teletact::service
