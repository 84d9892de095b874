// Who gets the imaging plane, and how long a call may hold its place: a greedy client beside a fair one,
// promises of time, cancellation, uploads and readers that do not get on, drain.
#include <algorithm>
#include <cstdio>
#include <functional>
#include <future>
#include <optional>
#include <thread>
#include <vector>

#include "service/device/cancellation.h"
#include "service/scene/errors.h"
#include "tests/rpc/estimate_client.h"

namespace teletact::service {
namespace {

using Clock = std::chrono::steady_clock;

// Work of a client that never ends, but looks up as all work does; it says how much it has left.
Workers::Running<void> endless(
    Server& server, const std::string& client, double cost_s = 0,
    const std::function<void()>& begins = [] {}) {
  JobTerms terms;
  terms.client = client;
  terms.cost_s = cost_s;
  return server.core().imaging.workers().run(terms, [begins] {
    begins();
    for (;;) {
      check_cancelled();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
}

// The pair so many times beside itself, every other time mirrored: an estimate that takes many turns.
struct Wide {
  explicit Wide(std::size_t times)
      : asked(acquisition()), frames{mirrored(pair().pre, times), mirrored(pair().post, times)} {
    asked.set_line_count(static_cast<std::uint32_t>(times * kLines));
    asked.mutable_probe_force()->set_force_n(static_cast<double>(times) * asked.probe_force().force_n());
    asked.mutable_probe_force()->set_contact_area_m2(static_cast<double>(times) *
                                                     asked.probe_force().contact_area_m2());
    asked.add_maps("valid");
  }
  v1::Acquisition asked;
  Pair frames;

 private:
  static std::string mirrored(const std::string& frame, std::size_t times) {
    constexpr std::size_t kLineBytes = kSamples * sizeof(float);
    std::string wide;
    for (std::size_t n = 0; n < times; ++n)
      for (std::size_t line = 0; line < kLines; ++line)
        wide.append(frame, kLineBytes * (n % 2 == 0 ? line : kLines - 1 - line), kLineBytes);
    return wide;
  }
};

double seconds_of(const Outcome& outcome, const std::string& stage) {
  for (const v1::StageTime& time : outcome.summary.stages())
    if (time.stage() == stage) return time.seconds();
  return 0;
}

class Plane : public OnOneServer {
 protected:
  Workers& workers() { return (*server)->core().imaging.workers(); }
};

TEST_F(Plane, EstimatesAreMadeInTimeBesideAClientThatWantsItAll) {
  std::vector<Workers::Running<void>> greedy;
  for (int k = 0; k < 8; ++k) greedy.push_back(endless(**server, "greedy@local", 60));
  Wide fair(4);
  fair.asked.set_finish_within_s(60);
  for (int k = 0; k < 2; ++k) {
    const Outcome outcome = estimate(channel, fair.asked, fair.frames);
    ASSERT_TRUE(outcome.status.ok()) << outcome.status.error_message();
    const double worked_s =
        seconds_of(outcome, "displacement") + seconds_of(outcome, "strain") + seconds_of(outcome, "modulus");
    ASSERT_GT(worked_s, 2 * Schedule::kSliceS) << "too short to tell";
    EXPECT_GT(seconds_of(outcome, "waited"), 0) << "after " << worked_s << " s it had not given way";
  }
  for (const auto& running : greedy) workers().cancel(running.id);
}

TEST_F(Plane, MapsAreTheSameWhetherOthersHaveTheirTurnOrNot) {
  v1::Acquisition a = acquisition();
  a.set_modulus_method(v1::MODULUS_METHOD_DIRECT);
  std::vector<std::string> maps[2];
  for (const bool shared : {false, true}) {
    std::optional<Workers::Running<void>> other;
    if (shared) other = endless(**server, "other@local");
    const Outcome outcome = estimate(channel, a);
    ASSERT_TRUE(outcome.status.ok()) << outcome.status.error_message();
    for (const v1::Map& map : outcome.maps) maps[shared].push_back(map.values().data());
    if (other) workers().cancel(other->id);
  }
  EXPECT_EQ(maps[0], maps[1]);
}

TEST_F(Plane, WhatCannotBeDoneInTimeIsRefusedBeforeItsUpload) {
  v1::Acquisition a = acquisition();
  a.set_finish_within_s(1e-4);
  Elastographer call(channel);
  call.send(a);
  v1::EstimateResponse response;
  EXPECT_FALSE(call.read(&response));
  expect_refused(call.finish().status, grpc::StatusCode::DEADLINE_EXCEEDED, "could be done in");
}

TEST_F(Plane, LateWorkIsRefusedAtOnceWithATime) {
  std::promise<void> begun;  // by the same client: it is finished first
  const auto mine = endless(**server, "local", 1000, [&] { begun.set_value(); });
  begun.get_future().wait();
  v1::Acquisition a = acquisition();
  a.set_finish_within_s(100);
  const Outcome outcome = estimate(channel, a);
  expect_refused(outcome.status, grpc::StatusCode::DEADLINE_EXCEEDED, "could be done in");
  EXPECT_TRUE(outcome.stages.empty());  // it never waited
  workers().cancel(mine.id);
}

TEST_F(Plane, NonsenseForATimeIsNamed) {
  for (const double bad : {-1.0, 1e9, std::nan("")}) {
    v1::Acquisition a = acquisition();
    a.set_finish_within_s(bad);
    Elastographer call(channel);
    call.send(a);
    expect_refused(call.finish().status, grpc::StatusCode::INVALID_ARGUMENT, "finish_within_s");
  }
}

TEST_F(Plane, MissedTimeEndsTheWorkItself) {
  std::promise<void> begun;  // by the same client: it is finished first
  const auto greedy = endless(**server, "local", 0, [&] { begun.set_value(); });  // it claims to be short
  begun.get_future().wait();
  // The least time that is promised: it depends on this machine, and on who was served lately.
  v1::Acquisition a = acquisition();
  Outcome outcome;
  for (double within_s = 0.25; outcome.stages.empty() && within_s < 100; within_s *= 1.5) {
    a.set_finish_within_s(within_s);
    outcome = estimate(channel, a);
  }
  EXPECT_EQ(outcome.status.error_code(), grpc::StatusCode::DEADLINE_EXCEEDED)
      << outcome.status.error_message();
  EXPECT_EQ(outcome.stages, std::vector<v1::EstimateStage>{v1::ESTIMATE_STAGE_RECEIVED});
  workers().cancel(greedy.id);
  server->expect_all_calls_end();
}

TEST_F(Plane, CancelledEstimateLeavesThePlaneToOthers) {
  for (const int pause_ms : {0, 50, 200}) {
    Elastographer call(channel);
    upload(call, acquisition());
    v1::EstimateResponse response;
    ASSERT_TRUE(call.read(&response));  // received
    std::this_thread::sleep_for(std::chrono::milliseconds(pause_ms));
    call.context().TryCancel();
    call.finish();
    server->expect_all_calls_end();
    workers().run({}, [] {}).future.get();
  }
}

// Eight estimates of one client, each longer than the other client's, and new to the engine one by one.
TEST(ImagingCalls, LongEstimatesOfOneClientDoNotHoldAnothers) {
  Limits limits;
  limits.max_estimates = 32, limits.client_memory_share = 1;
  RunningServer server("", "", limits);
  server->make_ready();
  const Wide fair(3);
  const auto window_s = [&] {
    Elastographer call(server.channel(), "fair");
    upload(call, fair.asked, fair.frames);
    const auto uploaded = Clock::now();
    const Outcome outcome = call.finish();
    EXPECT_TRUE(outcome.status.ok()) << outcome.status.error_message();
    return std::chrono::duration<double>(Clock::now() - uploaded).count();
  };
  const auto median_window_s = [&] {  // of three: what else this machine does comes and goes
    std::vector<double> windows_s{window_s(), window_s(), window_s()};
    std::sort(windows_s.begin(), windows_s.end());
    return windows_s[1];
  };
  double alone_s = median_window_s();
  Wide greedy(10);
  greedy.asked.set_modulus_time_limit_s(60);
  std::vector<std::unique_ptr<Elastographer>> calls;
  for (int k = 0; k < 8; ++k) {
    calls.push_back(std::make_unique<Elastographer>(server.channel(), "greedy"));
    greedy.asked.set_max_strain(k % 2 == 0 ? 0.1 : 0.05);
    upload(*calls.back(), greedy.asked, greedy.frames);
    v1::EstimateResponse received;
    ASSERT_TRUE(calls.back()->read(&received)) << calls.back()->finish().status.error_message();
  }
  const double beside_s = median_window_s();
  for (const auto& call : calls) call->context().TryCancel();
  EXPECT_EQ(calls.back()->finish().status.error_code(), grpc::StatusCode::CANCELLED)
      << "the greedy client had all it wanted: nothing is shown";
  server.expect_all_calls_end();
  alone_s = std::max(alone_s, median_window_s());
  // Twice its time alone and a turn; and as much again for a busy machine.
  EXPECT_LE(beside_s, 2 * (2 * alone_s + Schedule::kSliceS)) << "alone " << alone_s << " s";
  std::printf("[ turns ] a window alone %.3f s, beside eight of a greedy client %.3f s\n", alone_s, beside_s);
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
  expect_refused(call.finish().status, grpc::StatusCode::DEADLINE_EXCEEDED, "no bytes");
  server.expect_all_calls_end();
}

TEST(ImagingCalls, UploadThatNeverGetsDoneIsEnded) {
  Limits limits;
  limits.min_upload_s = 0.5;
  limits.min_upload_rate = 1e12;
  RunningServer server("", "", limits);
  server->make_ready();
  Elastographer call(server.channel());
  call.send(acquisition());
  for (std::uint64_t k = 0; k < 1200 && call.send(v1::FRAME_KIND_PRE, k, "x"); ++k)
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  expect_refused(call.finish().status, grpc::StatusCode::DEADLINE_EXCEEDED, "not whole");
  server.expect_all_calls_end();
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
  server.expect_all_calls_end();
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
