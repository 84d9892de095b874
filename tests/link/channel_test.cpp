#include "client/link/channel.h"

#include <gtest/gtest.h>

#include <stdexcept>
#include <vector>

#include "tests/support/fake_service.h"
#include "tests/support/localhost.h"

namespace teletact::client {
namespace {

TEST(ReachService, WaitsForOneThatIsStartingAndSaysSoOnce) {
  test::FakeServer server;
  server.palpation.starting_calls = 3;
  std::vector<std::string> said;
  const auto channel = reach_service(server.address(), {}, [&](const auto& line) { said.push_back(line); });
  EXPECT_EQ(channel->GetState(false), GRPC_CHANNEL_READY);
  EXPECT_EQ(server.palpation.starting_calls, 0);
  ASSERT_EQ(said.size(), 1u);
  EXPECT_NE(said[0].find("waiting for the service"), std::string::npos) << said[0];
  EXPECT_NE(said[0].find("starting"), std::string::npos) << said[0];
  reach_service(server.address(), {}, [](const auto& line) { ADD_FAILURE() << "nothing to say: " << line; });
}

// Work and memory are shared between clients by this name (info.proto).
TEST(MakeChannel, EveryCallNamesThisProcess) {
  test::FakeServer server;
  server.create_scene("s");
  const auto channel = make_channel(server.address());
  const auto palpation = v1::Palpation::NewStub(channel);
  {
    grpc::ClientContext context;
    v1::ListScenesResponse scenes;
    ASSERT_TRUE(palpation->ListScenes(&context, {}, &scenes).ok());
  }
  {
    grpc::ClientContext context;
    const auto stream = palpation->WatchFinger(&context);
    v1::WatchFingerRequest request;
    request.set_scene_id("s");
    v1::FingerState state;
    ASSERT_TRUE(stream->Write(request) && stream->Read(&state));
    context.TryCancel();
    EXPECT_EQ(stream->Finish().error_code(), grpc::StatusCode::CANCELLED);
  }
  const std::string& name = client_name();
  EXPECT_EQ(server.palpation.clients(), std::vector<std::string>({name, name}));
  EXPECT_LE(name.size(), 64u);
  EXPECT_NE(name.find(':' + std::to_string(getpid()) + ':'), std::string::npos) << name;
}

TEST(AddressProblem, IsSaidOfWhatCannotBeReached) {
  for (const char* address :
       {"localhost:1", "127.0.0.1:65535", "[::1]:50051", "unix:/tmp/s", "dns:here:50051"})
    EXPECT_EQ(address_problem(address), "") << address;
  for (const char* address : {"localhost", "localhost:", ":50051", "localhost:0", "localhost:65536",
                              "localhost:-1", "localhost:1x", "http://localhost:50051"})
    EXPECT_EQ(address_problem(address), std::string("give HOST:PORT or unix:/path, not ") + address);
  EXPECT_EQ(address_problem("unix:/" + std::string(106, 'd')), "");
  EXPECT_EQ(address_problem("unix:/" + std::string(107, 'd')),
            "the path has 108 bytes, a Unix socket's may have 107; choose a shorter one");
}

TEST(GrpcTarget, TakesNoHostForAScheme) {
  for (const char* host : {"dns", "ipv4", "ipv6", "xds", "localhost", "127.0.0.1"})
    EXPECT_EQ(grpc_target(host + std::string(":50051")), std::string("dns:///") + host + ":50051");
  for (const char* address : {"unix:/tmp/s", "unix:50051", "unix-abstract:50051", "[::1]:50051", "dns:here:1",
                              "dns:///here:1", "ipv4:127.0.0.1:1", "ipv6:[::1]:1", "localhost", "localhost:"})
    EXPECT_EQ(grpc_target(address), address);
}

TEST(NobodyAnswers, SaysWhenTheNameDoesNotResolve) {
  for (const char* address : {"nosuchhost.invalid:50972", "dns:nosuchhost.invalid:50972"})
    EXPECT_NE(nobody_answers(address, {}).find("the name nosuchhost.invalid does not resolve"),
              std::string::npos)
        << address;
  EXPECT_NE(nobody_answers("ipv4:50972", {}).find("the name ipv4 does not resolve"), std::string::npos);
  // A machine without /etc/hosts may not know it.
  EXPECT_NE(nobody_answers("localhost:1", {})
                .find(test::knows_localhost() ? "start one with" : "the name localhost does not resolve"),
            std::string::npos);
  for (const char* address : {"127.0.0.1:1", "[::1]:1", "ipv4:127.0.0.1:1", "unix:/tmp/x:1"})
    EXPECT_NE(nobody_answers(address, {}).find("start one with"), std::string::npos) << address;
}

TEST(NobodyAnswers, AsksForACertificateThatIsValidNow) {
  Credentials given;
  given.tls_ca = "certificate";
  for (const char* own : {"", "certificate"}) {
    given.tls_certificate = own;
    const std::string message = nobody_answers("127.0.0.1:1", given);
    EXPECT_NE(message.find("or TLS with it failed: start one"), std::string::npos) << message;
    EXPECT_NE(message.find("valid by this machine's clock"), std::string::npos) << message;
  }
}

TEST(ReachService, SaysWhenNobodyIsThere) {
  try {
    reach_service(
        "unix:/tmp/teletact-nobody-listens-here", {}, [](const auto&) {}, 0.1);
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("no service at"), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace teletact::client
