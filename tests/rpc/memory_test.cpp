// Peers that ask for more memory than they may have are told so, and the service says what it holds.
#include <thread>

#include "service/rpc/call_metadata.h"
#include "service/rpc/status.h"
#include "tests/rpc/running_server.h"

namespace teletact::service {
namespace {

v1::GetInfoResponse info_of(const RunningServer& server) {
  grpc::ClientContext context;
  set_deadline(context);
  v1::GetInfoResponse info;
  EXPECT_TRUE(v1::Info::NewStub(server.channel())->GetInfo(&context, {}, &info).ok());
  return info;
}

std::uint64_t held(const v1::GetInfoResponse& info, const std::string& place) {
  std::uint64_t bytes = 0;
  for (const v1::MemoryUse& use : info.memory())
    if (use.place() == place) bytes += use.bytes();
  return bytes;
}

TEST(Memory, IsReportedByPlaceAndKindAndReturnedWithTheScene) {
  RunningServer server;
  server->make_ready();
  // One that holds nothing says so, of both places.
  const v1::GetInfoResponse empty = info_of(server);
  for (const char* place : {"host", "device"}) {
    EXPECT_TRUE(std::any_of(empty.memory().begin(), empty.memory().end(), [&](const auto& use) {
      return use.place() == place;
    })) << place;
    EXPECT_EQ(held(empty, place), 0U) << place;
  }
  const std::uint64_t before = held(empty, "host");
  ASSERT_TRUE(server.create(uniform_scene("s")).ok());
  const v1::GetInfoResponse info = info_of(server);
  EXPECT_GT(held(info, "host"), before + 1000 * sizeof(double));
  EXPECT_TRUE(std::any_of(info.memory().begin(), info.memory().end(),
                          [](const auto& use) { return use.kind() == "models" && use.bytes() > 0; }));
  ASSERT_TRUE(server.remove("s").ok());
  // Whoever worked for it lets go of it soon.
  for (int k = 0; k < 1000 && held(info_of(server), "host") != before; ++k)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  EXPECT_EQ(held(info_of(server), "host"), before);
}

TEST(Memory, ClientBeyondItsShareIsRefusedAlone) {
  Limits limits;
  limits.host_memory_bytes = 20 << 20, limits.client_memory_share = 0.1;
  RunningServer server("", "", limits);
  server->make_ready();
  ASSERT_TRUE(server.create(uniform_scene("a"), "anna").ok());
  grpc::Status refused = grpc::Status::OK;
  for (int k = 0; k < 30 && refused.ok(); ++k)
    refused = server.create(uniform_scene("a" + std::to_string(k)), "anna");
  EXPECT_EQ(refused.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED) << refused.error_message();
  for (const char* word : {"bytes", "this client holds", "delete scenes"})
    EXPECT_NE(refused.error_message().find(word), std::string::npos) << refused.error_message();
  EXPECT_TRUE(server.create(uniform_scene("b"), "berta").ok());
}

// A client with a share of 20 kB.
class SmallShare : public testing::Test {
 protected:
  SmallShare() { server->make_ready(); }
  static Limits limits() {
    Limits limits;
    limits.host_memory_bytes = 20'000'000, limits.client_memory_share = 0.001;
    return limits;
  }
  RunningServer server{"", "", limits()};
};

TEST_F(SmallShare, AModulusIsNotReadBeforeThereIsRoomForIt) {
  v1::CreateSceneRequest request = uniform_scene("s", 10e3, 0.2, 0.08);  // 16 kB
  request.mutable_modulus()->mutable_youngs_modulus_pa()->set_dtype(v1::DATA_TYPE_UNSPECIFIED);
  expect_refused(server.create(request), grpc::StatusCode::RESOURCE_EXHAUSTED, "bytes for uploads");
}

TEST_F(SmallShare, AListOfScenesIsChargedToWhoAsksForIt) {
  const auto list = [&] {
    grpc::ClientContext context;
    set_deadline(context);
    v1::ListScenesResponse scenes;
    return v1::Palpation::NewStub(server.channel())->ListScenes(&context, {}, &scenes);
  };
  EXPECT_TRUE(list().ok());
  for (std::uint64_t k = 0; k < Limits{}.max_scenes; ++k) {
    v1::CreateSceneRequest request = uniform_scene("s" + std::to_string(k));
    request.clear_modulus();
    ASSERT_TRUE(server.create(request, "client " + std::to_string(k)).ok());
  }
  expect_refused(list(), grpc::StatusCode::RESOURCE_EXHAUSTED, "bytes for answers");
}

// Each number is finite and positive; what is made of them is not.
TEST(Memory, UnusableNumbersAreTheClientsAndNotInternal) {
  RunningServer server;
  server->make_ready();
  for (const double modulus_pa : {1e-320, 1.7e308}) {
    v1::CreateSceneRequest request = uniform_scene("s");
    v1::ModulusMap* map = request.mutable_modulus();
    const std::size_t elements = static_cast<std::size_t>((map->x_m_size() - 1) * (map->y_m_size() - 1));
    const std::vector<double> values(elements, modulus_pa);
    map->mutable_youngs_modulus_pa()->set_dtype(v1::DATA_TYPE_FLOAT64);
    map->mutable_youngs_modulus_pa()->set_data(values.data(), values.size() * sizeof(double));
    expect_refused(server.create(request), grpc::StatusCode::INVALID_ARGUMENT,
                   "modulus.youngs_modulus_pa[0]: ");
  }
}

TEST(Memory, WhatRunsOutOfMemoryIsExhaustedAndSaysWhatToDo) {
  const auto code_of = [](auto error) {
    const grpc::Status status = status_of(std::make_exception_ptr(error));
    EXPECT_NE(status.error_message(), "");
    return status.error_code();
  };
  EXPECT_EQ(code_of(std::bad_alloc()), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(code_of(MemoryRefused("memory")), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(code_of(DeviceMemoryError("memory")), grpc::StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(code_of(DeviceError("lost")), grpc::StatusCode::INTERNAL);
  EXPECT_EQ(code_of(std::domain_error("not finite")), grpc::StatusCode::INVALID_ARGUMENT);
}

}  // namespace
}  // namespace teletact::service
