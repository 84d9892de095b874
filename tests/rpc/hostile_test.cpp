// Clients that mean no good, or are broken: what they can hold is bounded, and the others are served on.
#include <malloc.h>
#include <future>
#include <optional>
#include <vector>

#include "service/rpc/free_memory.h"
#include "tests/rpc/estimate_client.h"
#include "tests/support/finger_reader.h"

namespace teletact::service {
namespace {

std::size_t resident_bytes() {
  malloc_trim(0);  // what is held, not what the allocator has not given back yet
  return resident_bytes_now();
}

using Hostile = OnOneServer;

TEST_F(Hostile, ThousandsOfStreamsThatComeAndGoLeaveNothing) {
  const std::size_t before = resident_bytes();
  {
    Bystander bystander(server->channel(), "s");
    for (int k = 0; k < 2000; ++k) {
      Toucher toucher(channel, "s");  // cancelled at once, opened or not
      if (k % 3 == 0) toucher.opened();
      if (k % 7 == 0) toucher.send(0.05, 0.002);
    }
    bystander.stop();
    EXPECT_EQ(bystander.failures(), 0);
  }
  server->expect_all_calls_end();
  EXPECT_LT(resident_bytes(), before + (std::size_t{64} << 20));
}

TEST_F(Hostile, FloodOfPosesThatNobodyReadsIsBounded) {
  const std::size_t before = resident_bytes();
  Bystander bystander(server->channel(), "s");
  Toucher flood(server->channel(), "s");
  ASSERT_TRUE(flood.opened());
  flood.stop_acknowledging();
  v1::TouchRequest request;
  for (const double v : {0.05, 0.002}) request.mutable_pose()->add_position_m(v);
  for (std::uint64_t k = 1; k <= 4000; ++k) {
    request.mutable_pose()->set_sequence(k);
    ASSERT_TRUE(flood.send_as_is(request));
  }
  bystander.stop();
  EXPECT_EQ(bystander.failures(), 0);
  EXPECT_LT(resident_bytes(), before + (std::size_t{64} << 20));
  std::size_t unread = 0;
  EXPECT_TRUE(flood.finish(&unread).ok());
  EXPECT_LE(unread, 1U);  // its credit
}

TEST_F(Hostile, HugeRepeatedFieldsAreRefusedByName) {
  for (const bool velocity : {false, true}) {
    Toucher toucher(server->channel(), "s");
    ASSERT_TRUE(toucher.opened());
    v1::TouchRequest request;
    v1::ContactPose* pose = request.mutable_pose();
    pose->set_sequence(1);
    for (int k = 0; k < (velocity ? 2 : 200'000); ++k) pose->add_position_m(0.01);
    for (int k = 0; k < (velocity ? 200'000 : 2); ++k) pose->add_velocity_m_s(0.01);
    toucher.send_as_is(request);
    expect_refused(toucher.finish(), grpc::StatusCode::INVALID_ARGUMENT,
                   velocity ? "velocity_m_s" : "position_m");
  }
}

TEST_F(Hostile, AcknowledgingUnsentAnswersEndsTheStream) {
  for (const std::uint64_t acknowledged : {std::uint64_t{1}, std::uint64_t{1} << 40, UINT64_MAX}) {
    Toucher toucher(server->channel(), "s");
    ASSERT_TRUE(toucher.opened());
    v1::TouchRequest request;
    for (const double v : {0.05, 0.002}) request.mutable_pose()->add_position_m(v);
    request.mutable_pose()->set_sequence(1);
    request.mutable_pose()->set_acknowledged(acknowledged);
    toucher.send_as_is(request);
    expect_refused(toucher.finish(), grpc::StatusCode::INVALID_ARGUMENT, "pose.acknowledged");
  }
}

TEST_F(Hostile, UploadsThatAreGivenUpKeepNoFrames) {
  // The worker is held; frames of 8 MiB that are waiting for it as 16 MiB of floats each.
  constexpr std::size_t kCalls = 12, kBytes = std::size_t{2} * 2048 * 2048;
  std::promise<void> release;
  (*server)->core().imaging.workers().run({}, [&] { release.get_future().wait(); });
  const Pair frames{std::string(kBytes, '\1'), std::string(kBytes, '\1')};
  v1::Acquisition a = acquisition();
  a.set_dtype(v1::DATA_TYPE_INT16);
  a.set_sample_count(2048), a.set_line_count(2048);
  a.set_line_pitch_m(1e-4);
  std::size_t most = 0, first = 0;
  for (std::size_t k = 0; k < kCalls; ++k) {
    {
      Elastographer call(channel);
      upload(call, a, frames);
      v1::EstimateResponse received;
      EXPECT_TRUE(call.read(&received)) << call.finish().status.error_message();
      EXPECT_EQ(received.progress().stage(), v1::ESTIMATE_STAGE_RECEIVED);
      call.context().TryCancel();
      call.finish();
    }
    server->expect_all_calls_end();
    if (k == 1) first = resident_bytes();
    most = std::max(most, resident_bytes());
  }
  release.set_value();
  EXPECT_LT(most, first + 4 * 4 * kBytes);  // of (kCalls - 2) pairs, 4 kBytes each
}

TEST_F(Hostile, NoMoreWatchersAndUploadsThanStated) {
  const auto stub = v1::Palpation::NewStub(channel);
  struct Watcher {
    grpc::ClientContext context;
    std::optional<FingerReader> stream;
    ~Watcher() { context.TryCancel(); }
  };
  std::vector<std::unique_ptr<Watcher>> watchers;
  v1::FingerState state;
  for (std::size_t k = 0; k <= Limits{}.max_watchers; ++k) {
    auto& watcher = *watchers.emplace_back(std::make_unique<Watcher>());
    set_deadline(watcher.context);
    watcher.stream.emplace(*stub, watcher.context, "s");
    if (k < Limits{}.max_watchers)
      ASSERT_TRUE(watcher.stream->read(&state)) << k;
    else
      EXPECT_EQ(watcher.stream->finish().error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  }
  std::vector<std::unique_ptr<Elastographer>> uploads;
  for (std::size_t k = 0; k < Limits{}.max_estimates; ++k) {
    uploads.push_back(std::make_unique<Elastographer>(channel, "client-" + std::to_string(k)));
    uploads.back()->send(acquisition());
  }
  while ((*server)->core().calls.count() < Limits{}.max_watchers + Limits{}.max_estimates)
    std::this_thread::yield();
  Elastographer one_too_many(channel, "another client");
  expect_refused(one_too_many.finish().status, grpc::StatusCode::RESOURCE_EXHAUSTED, "places for estimates");
  Toucher toucher(channel, "s");
  v1::TouchAnswer answer;
  EXPECT_TRUE(toucher.opened() && toucher.touch(0.05, 0.002, &answer));  // touch has places of its own
  for (const auto& upload : uploads) upload->context().TryCancel(), upload->finish();
}

TEST_F(Hostile, OneClientDoesNotTakeAllPlacesForUploads) {
  const std::size_t most = Limits{}.max_estimates;
  std::vector<std::unique_ptr<Elastographer>> uploads;
  const auto upload_of = [&](const std::string& client) {
    uploads.push_back(std::make_unique<Elastographer>(channel, client));
    uploads.back()->send(acquisition());
    while ((*server)->core().calls.count() < uploads.size()) std::this_thread::yield();
  };
  for (std::size_t k = 0; k < most / 2; ++k) upload_of("greedy");
  for (const char* client : {"greedy", "modest"}) {
    if (client == std::string("modest")) upload_of(client);
    Elastographer one_more(channel, "greedy");
    expect_refused(one_more.finish().status, grpc::StatusCode::RESOURCE_EXHAUSTED, "this client's");
  }
  while (uploads.size() < most) upload_of("client-" + std::to_string(uploads.size()));
  for (const auto& upload : uploads) upload->context().TryCancel(), upload->finish();
  server->expect_all_calls_end();
}

}  // namespace
}  // namespace teletact::service
