#include "client/link/channel.h"

#include <gtest/gtest.h>

#include <stdexcept>
#include <vector>

#include "tests/support/fake_service.h"

namespace teletact::client {
namespace {

TEST(ReachService, WaitsForOneThatIsStartingAndSaysSoOnce) {
  test::FakeServer server;
  server.palpation.starting_calls = 3;
  std::vector<std::string> said;
  const auto channel = reach_service(server.address(), "", [&](const auto& line) { said.push_back(line); });
  EXPECT_EQ(channel->GetState(false), GRPC_CHANNEL_READY);
  EXPECT_EQ(server.palpation.starting_calls, 0);
  ASSERT_EQ(said.size(), 1u);
  EXPECT_NE(said[0].find("waiting for the service"), std::string::npos) << said[0];
  EXPECT_NE(said[0].find("starting"), std::string::npos) << said[0];
  reach_service(server.address(), "", [](const auto& line) { ADD_FAILURE() << "nothing to say: " << line; });
}

TEST(ReachService, SaysWhenNobodyIsThere) {
  try {
    reach_service("unix:/tmp/teletact-nobody-listens-here", "", [](const auto&) {});
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("no service at"), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace teletact::client
