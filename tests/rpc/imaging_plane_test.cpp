// Who gets the imaging plane, and how long a call may hold its place: a greedy client beside a fair one,
// promises of time, cancellation, uploads and readers that do not get on, drain.
#include <atomic>
#include <future>
#include <thread>

#include "service/device/look.h"
#include "service/scene/errors.h"
#include "tests/rpc/estimate_client.h"

namespace teletact::service {
namespace {

using Clock = std::chrono::steady_clock;

// Work of a client that never ends, but looks up as all work does; it says how much it has left.
FairWorkers::Running<void> endless(Server& server, const std::string& client, double cost_s = 0) {
  JobTerms terms;
  terms.client = client;
  terms.cost_s = cost_s;
  return server.core().scenes.worker().run(terms, [] {
    for (;;) {
      look();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
}

void upload(Elastographer& call, const v1::Acquisition& a) {
  call.send(a);
  call.send_frame(v1::FRAME_KIND_PRE, pair().pre);
  call.send_frame(v1::FRAME_KIND_POST, pair().post);
  call.close();
}

void expect_no_calls(Server& server) {
  server.core().calls.wait_until_none(Clock::now() + std::chrono::seconds(60));
  EXPECT_EQ(server.core().calls.count(), 0U);
}

class ImagingPlane : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    server = std::make_unique<RunningServer>();
    (*server)->make_ready();
  }
  static void TearDownTestSuite() { server.reset(); }
  FairWorkers& workers() { return (*server)->core().scenes.worker(); }
  static inline std::unique_ptr<RunningServer> server;
};

TEST_F(ImagingPlane, EstimatesAreMadeInTimeBesideAClientThatWantsItAll) {
  std::vector<FairWorkers::Running<void>> greedy;
  for (int k = 0; k < 8; ++k) greedy.push_back(endless(**server, "greedy@local", 60));
  v1::Acquisition a = acquisition();
  a.set_finish_within_s(60);
  for (int k = 0; k < 2; ++k) {
    Elastographer fair(server->channel());
    upload(fair, a);
    const Outcome outcome = fair.finish();
    ASSERT_TRUE(outcome.status.ok()) << outcome.status.error_message();
  }
  for (const auto& running : greedy) workers().cancel(running.id);
}

TEST_F(ImagingPlane, MapsAreTheSameWhetherOthersHaveTheirTurnOrNot) {
  v1::Acquisition a = acquisition();
  a.set_modulus_method(v1::MODULUS_METHOD_DIRECT);
  std::vector<std::string> maps[2];
  for (const bool shared : {false, true}) {
    std::optional<FairWorkers::Running<void>> other;
    if (shared) other = endless(**server, "other@local");
    Elastographer call(server->channel());
    upload(call, a);
    const Outcome outcome = call.finish();
    ASSERT_TRUE(outcome.status.ok()) << outcome.status.error_message();
    for (const v1::Map& map : outcome.maps) maps[shared].push_back(map.values().data());
    if (other) workers().cancel(other->id);
  }
  EXPECT_EQ(maps[0], maps[1]);
}

TEST_F(ImagingPlane, WhatCannotBeDoneInTimeIsRefusedBeforeItsUpload) {
  v1::Acquisition a = acquisition();
  a.set_finish_within_s(1e-4);
  Elastographer call(server->channel());
  call.send(a);
  v1::EstimateResponse response;
  EXPECT_FALSE(call.read(&response));
  const grpc::Status status = call.finish().status;
  EXPECT_EQ(status.error_code(), grpc::StatusCode::DEADLINE_EXCEEDED);
  EXPECT_NE(status.error_message().find("could be done in"), std::string::npos) << status.error_message();
}

TEST_F(ImagingPlane, WhatCannotBeDoneInTimeBesideOthersIsRefusedAtOnceWithATime) {
  const auto mine = endless(**server, "local", 1000);  // of the same client: it is finished first
  v1::Acquisition a = acquisition();
  a.set_finish_within_s(100);
  Elastographer call(server->channel());
  upload(call, a);
  const Outcome outcome = call.finish();
  EXPECT_EQ(outcome.status.error_code(), grpc::StatusCode::DEADLINE_EXCEEDED);
  EXPECT_NE(outcome.status.error_message().find("could be done in"), std::string::npos)
      << outcome.status.error_message();
  EXPECT_TRUE(outcome.stages.empty());  // it never waited
  workers().cancel(mine.id);
}

TEST_F(ImagingPlane, NonsenseForATimeIsNamed) {
  for (const double bad : {-1.0, 1e9, std::nan("")}) {
    v1::Acquisition a = acquisition();
    a.set_finish_within_s(bad);
    Elastographer call(server->channel());
    call.send(a);
    const grpc::Status status = call.finish().status;
    EXPECT_EQ(status.error_code(), grpc::StatusCode::INVALID_ARGUMENT) << bad;
    EXPECT_NE(status.error_message().find("finish_within_s"), std::string::npos) << status.error_message();
  }
}

TEST_F(ImagingPlane, MissedTimeEndsTheWorkItself) {
  const auto greedy = endless(**server, "local");  // it claims to be short, and is not
  // By now nobody else was served lately.
  std::this_thread::sleep_for(FairQueue::kLately + std::chrono::milliseconds(100));
  v1::Acquisition a = acquisition();
  a.set_finish_within_s(10);
  Elastographer call(server->channel());
  upload(call, a);
  const Outcome outcome = call.finish();
  EXPECT_EQ(outcome.status.error_code(), grpc::StatusCode::DEADLINE_EXCEEDED)
      << outcome.status.error_message();
  EXPECT_EQ(outcome.stages, std::vector<v1::EstimateStage>{v1::ESTIMATE_STAGE_RECEIVED});
  workers().cancel(greedy.id);
  expect_no_calls(**server);
}

TEST_F(ImagingPlane, CancelledEstimateLeavesThePlaneToOthers) {
  for (const int pause_ms : {0, 50, 200}) {
    Elastographer call(server->channel());
    upload(call, acquisition());
    v1::EstimateResponse response;
    ASSERT_TRUE(call.read(&response));  // received
    std::this_thread::sleep_for(std::chrono::milliseconds(pause_ms));
    call.context().TryCancel();
    call.finish();
    expect_no_calls(**server);
    workers().run({}, [] {}).future.get();
  }
}

TEST(ImagingCalls, EmptyChunksAreNoProgress) {
  Limits limits;
  limits.upload_idle_s = 0.5;
  RunningServer server("", "", limits);
  server->make_ready();
  Elastographer call(server.channel());
  call.send(acquisition());
  for (int k = 0; k < 1200 && call.send(v1::FRAME_KIND_PRE, 0, ""); ++k)
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  const grpc::Status status = call.finish().status;
  EXPECT_EQ(status.error_code(), grpc::StatusCode::DEADLINE_EXCEEDED) << status.error_message();
  EXPECT_NE(status.error_message().find("no bytes"), std::string::npos) << status.error_message();
  expect_no_calls(*server);
}

TEST(ImagingCalls, UploadThatNeverGetsDoneIsEnded) {
  Limits limits;
  limits.least_upload_s = 0.5;
  limits.least_upload_rate = 1e12;
  RunningServer server("", "", limits);
  server->make_ready();
  Elastographer call(server.channel());
  call.send(acquisition());
  for (std::uint64_t k = 0; k < 1200 && call.send(v1::FRAME_KIND_PRE, k, "x"); ++k)
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  const grpc::Status status = call.finish().status;
  EXPECT_EQ(status.error_code(), grpc::StatusCode::DEADLINE_EXCEEDED) << status.error_message();
  EXPECT_NE(status.error_message().find("not whole"), std::string::npos) << status.error_message();
  expect_no_calls(*server);
}

TEST(ImagingCalls, ReaderThatDoesNotReadLosesItsPlace) {
  Limits limits;
  limits.answer_taken_s = 0.5;
  RunningServer server("", "", limits);
  server->make_ready();
  grpc::ChannelArguments arguments;  // little is sent to a reader that does not read
  arguments.SetInt(GRPC_ARG_HTTP2_STREAM_LOOKAHEAD_BYTES, 4096);
  arguments.SetInt(GRPC_ARG_HTTP2_BDP_PROBE, 0);
  Elastographer call(
      grpc::CreateCustomChannel(server->address(), grpc::InsecureChannelCredentials(), arguments));
  upload(call, acquisition());
  while (server->core().calls.count() == 0) std::this_thread::yield();
  expect_no_calls(*server);
  EXPECT_FALSE(call.finish().status.ok());
}

TEST(ImagingCalls, DrainEndsWhatRunsWithoutWaitingForIt) {
  RunningServer server;
  server->make_ready();
  auto work = endless(*server, "greedy@local");
  Elastographer call(server.channel());
  upload(call, acquisition());
  v1::EstimateResponse response;
  ASSERT_TRUE(call.read(&response));
  const auto begun = Clock::now();
  server->drain();
  EXPECT_LT(Clock::now() - begun, std::chrono::seconds(5));
  EXPECT_EQ(call.finish().status.error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_THROW(work.future.get(), Error);
}

}  // namespace
}  // namespace teletact::service
