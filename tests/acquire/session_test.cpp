#include "client/acquire/session.h"

#include <gtest/gtest.h>

#include <atomic>
#include <map>
#include <stdexcept>
#include <thread>
#include <utility>

#include "client/link/channel.h"
#include "tests/files/temporary_folder.h"
#include "tests/support/fake_service.h"

namespace teletact::client {
namespace {

constexpr std::uint32_t kSamples = 700, kLines = 500;  // 1.4 MB per frame: more than one chunk

// Frames that say which window and pass they are.
class NumberedFrames final : public FrameSource {
 public:
  explicit NumberedFrames(std::size_t windows, std::size_t passes) : left_(windows, passes) {}
  std::size_t window_count() const override { return left_.size(); }
  double window_width_m() const override { return 0.06; }
  double compression_m() const override { return 0.00045; }
  std::size_t frames_left(std::size_t window) const override { return left_.at(window); }
  FramePair take(std::size_t window) override {
    if (left_.at(window) == 0) throw std::out_of_range("no frames left");
    --left_[window];
    FramePair pair;
    pair.acquisition.set_sample_count(kSamples);
    pair.acquisition.set_line_count(kLines);
    pair.acquisition.set_dtype(v1::DATA_TYPE_FLOAT32);
    pair.acquisition.mutable_probe_force()->set_force_n(3 + window);
    pair.pre.assign(std::size_t{4} * kSamples * kLines, static_cast<char>(window));
    pair.post.assign(pair.pre.size(), static_cast<char>(100 + left_[window]));
    return pair;
  }

 private:
  std::vector<std::size_t> left_;
};

TEST(EstimateClient, SendsBothFramesInChunksOfOneMebibyte) {
  test::FakeServer server;
  NumberedFrames frames(1, 1);
  const FramePair pair = frames.take(0);
  EstimateClient client(make_channel(server.address()));
  const auto outcome = client.estimate(pair.acquisition, pair.pre, pair.post, {}, false);
  const auto calls = server.elastography.calls();
  ASSERT_EQ(calls.size(), 1u);
  EXPECT_EQ(calls[0].pre, pair.pre);
  EXPECT_EQ(calls[0].post, pair.post);
  EXPECT_LE(calls[0].largest_chunk, std::size_t{1} << 20);
  EXPECT_TRUE(outcome.summary.modulus_absolute());
  EXPECT_GE(outcome.published_ns, outcome.last_byte_ns);
  EXPECT_EQ(outcome.attempts, 1u);
}

TEST(EstimateClient, TriesAgainOnlyWhileUnavailable) {
  test::FakeServer server;
  NumberedFrames frames(1, 1);
  const FramePair pair = frames.take(0);
  EstimateClient client(make_channel(server.address()), 5);
  server.elastography.unavailable_calls = 2;
  EstimateCallbacks callbacks;
  std::vector<std::string> said;
  callbacks.waiting = [&](const std::string& line) { said.push_back(line); };
  EXPECT_EQ(client.estimate(pair.acquisition, pair.pre, pair.post, callbacks, false).attempts, 3u);
  ASSERT_EQ(said.size(), 1u);
  EXPECT_NE(said[0].find("draining"), std::string::npos) << said[0];
  server.elastography.untracked_calls = 1;
  try {
    client.estimate(pair.acquisition, pair.pre, pair.post, {}, false);
    FAIL() << "a refused call was repeated or taken for a success";
  } catch (const ServiceError& error) {
    EXPECT_EQ(error.code, grpc::StatusCode::FAILED_PRECONDITION);
    EXPECT_NE(std::string(error.what()).find("FAILED_PRECONDITION"), std::string::npos) << error.what();
  }
}

// Ends its first call in the middle, as one that is restarted does.
class DiesOnce final : public v1::Elastography::Service {
 public:
  grpc::Status Estimate(
      grpc::ServerContext*,
      grpc::ServerReaderWriter<v1::EstimateResponse, v1::EstimateRequest>* stream) override {
    for (v1::EstimateRequest request; stream->Read(&request);) continue;
    v1::EstimateResponse response;
    response.mutable_map()->mutable_map()->set_name(died_ ? "whole" : "cut short");
    stream->Write(response);
    if (!std::exchange(died_, true)) return {grpc::StatusCode::UNAVAILABLE, "killed"};
    response.mutable_summary()->set_quality(0.5);
    stream->Write(response);
    return grpc::Status::OK;
  }

 private:
  bool died_ = false;
};

TEST(EstimateClient, KeepsNothingOfACallThatWasCutShort) {
  DiesOnce service;
  const TemporaryFolder folder;
  const std::string address = "unix:" + (folder / "s").string();
  grpc::ServerBuilder builder;
  builder.AddListeningPort(address, grpc::InsecureServerCredentials());
  builder.SetSyncServerOption(grpc::ServerBuilder::CQ_TIMEOUT_MSEC, 100);
  builder.RegisterService(&service);
  const auto server = builder.BuildAndStart();
  EstimateClient client(make_channel(address), 5);
  const EstimateOutcome outcome = client.estimate({}, "pre", "post", {}, false);
  server->Shutdown(std::chrono::system_clock::now());
  EXPECT_EQ(outcome.attempts, 2u);
  ASSERT_EQ(outcome.maps.size(), 1u);
  EXPECT_EQ(outcome.maps[0].name(), "whole");
}

TEST(EstimateClient, GivesUpOnAServiceThatNeverComes) {
  EstimateClient client(make_channel("unix:/tmp/teletact-nobody-listens-here"), 0.2);
  NumberedFrames frames(1, 1);
  const FramePair pair = frames.take(0);
  try {
    client.estimate(pair.acquisition, pair.pre, pair.post, {}, false);
    FAIL();
  } catch (const ServiceError& error) {
    EXPECT_EQ(error.code, grpc::StatusCode::UNAVAILABLE);
  }
}

AcquireOptions session_options() {
  AcquireOptions options;
  options.scene_id = "s";
  options.until_finger_leaves = true;
  options.finger_gone_s = 0.05;
  options.arm.speed_m_s = 30;  // the claims here are about order, not about time
  options.arm.acceleration_m_s2 = 3000;
  options.arm.frame_rate_hz = 1000;
  options.arm.settle_s = 0;
  return options;
}

TEST(AcquireSession, PublishesAheadOfTheFingerUntilItLeaves) {
  test::FakeServer server;
  server.create_scene("s");
  NumberedFrames frames(5, 1);
  std::atomic<bool> stop{false}, ready{false};
  std::atomic<int> published{0}, published_when_ready{0};
  AcquireObserver observer;
  observer.window = [&](auto, const auto&, const auto&) { ++published; };
  observer.ready = [&] {
    published_when_ready = published.load();
    ready = true;
    server.palpation.set_finger(true, 0.25, 0.0);  // the finger appears elsewhere and goes left
    server.palpation.set_finger(true, 0.25, -0.12);
  };
  AcquireOptions options = session_options();
  options.stated.mutable_probe_force()->set_force_std_n(0.5), options.stated.set_poisson_ratio_std(0.02);
  AcquireSession session(server.address(), {}, frames, options, observer);
  std::thread operator_side([&] {
    while (published < 5) std::this_thread::yield();
    server.palpation.set_finger(false, 0.25, 0);
  });
  const AcquireResult result = session.run(stop);
  operator_side.join();
  EXPECT_TRUE(ready);
  EXPECT_EQ(published_when_ready, 3);  // the start window and two ahead
  std::vector<double> order;
  for (const auto& window : result.windows) order.push_back(window.window().origin_m(0));
  const std::vector<double> expected{0.0, 0.06, 0.12, 0.24, 0.18};
  ASSERT_EQ(order.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_NEAR(order[i], expected[i], 1e-12) << i;
  const auto calls = server.elastography.calls();
  ASSERT_EQ(calls.size(), 5u);
  for (const auto& call : calls) {
    EXPECT_EQ(call.acquisition.publish().scene_id(), "s");
    const int window = static_cast<int>(call.acquisition.publish().window().origin_m(0) / 0.06 + 0.5);
    EXPECT_EQ(call.pre[0], static_cast<char>(window)) << "a window was published with another's frames";
    EXPECT_NEAR(call.acquisition.probe_force().force_n(), 3 + window, 1e-12);
    EXPECT_EQ(call.acquisition.probe_force().force_std_n(), 0.5);
    EXPECT_EQ(call.acquisition.poisson_ratio_std(), 0.02);
  }
  for (const auto& t : result.windows) {
    EXPECT_LE(t.asked_ns(), t.acquired_ns());
    EXPECT_LE(t.acquired_ns(), t.last_byte_ns());
    EXPECT_LE(t.last_byte_ns(), t.published_ns());
  }
}

TEST(AcquireSession, AWindowThatIsRefusedIsSaidAndAcquiredAgain) {
  test::FakeServer server;
  server.create_scene("s");
  server.elastography.untracked_calls = 1;
  NumberedFrames frames(1, 3);
  std::atomic<bool> stop{false};
  AcquireOptions options = session_options();
  AcquireObserver observer;
  std::vector<std::string> said;
  observer.note = [&](const std::string& line) { said.push_back(line); };
  observer.ready = [&] { stop = true; };
  AcquireSession session(server.address(), {}, frames, options, observer);
  const AcquireResult result = session.run(stop);
  ASSERT_EQ(said.size(), 1u);
  EXPECT_NE(said[0].find("FAILED_PRECONDITION"), std::string::npos) << said[0];
  EXPECT_EQ(result.refused, 1u);
  EXPECT_EQ(result.windows.size(), 1u);
  EXPECT_EQ(frames.frames_left(0), 1u);
}

TEST(AcquireSession, SaysWhyWhenTheSceneIsUnknown) {
  test::FakeServer server;
  NumberedFrames frames(1, 1);
  std::atomic<bool> stop{false};
  AcquireSession session(server.address(), {}, frames, session_options(), {});
  try {
    session.run(stop);
    FAIL();
  } catch (const ServiceError& error) {
    EXPECT_NE(std::string(error.what()).find("NOT_FOUND"), std::string::npos) << error.what();
  }
}

TEST(AcquireSession, ASliceOfAPlaneSceneIsNotTaken) {
  test::FakeServer server;
  server.create_scene("s");
  server.palpation.set_wish(0, 1);
  NumberedFrames frames(5, 1);
  std::atomic<bool> stop{false};
  std::vector<std::string> said;
  AcquireObserver observer;
  std::atomic<int> both{0};  // all is ready, and something was said: whichever comes last
  const auto one_of_both = [&] { stop = ++both >= 2; };
  observer.ready = one_of_both;
  observer.note = [&](const std::string& line) {
    said.push_back(line);
    one_of_both();
  };
  AcquireSession session(server.address(), {}, frames, session_options(), observer);
  session.run(stop);
  EXPECT_EQ(said,
            (std::vector<std::string>{"ignored: a slice is asked for at z = 0.0 mm, in a plane scene"}));
}

TEST(AcquireSession, TheArmMovesOnWhileTheServiceComputes) {
  test::FakeServer server;
  server.create_scene("s");
  server.elastography.compute_ms = 100;
  NumberedFrames frames(3, 1);
  std::atomic<bool> stop{false};
  AcquireObserver observer;
  observer.ready = [&] { stop = true; };
  AcquireSession session(server.address(), {}, frames, session_options(), observer);
  const AcquireResult result = session.run(stop);
  ASSERT_EQ(result.windows.size(), 3u);
  EXPECT_LT(result.windows[1].acquired_ns(), result.windows[0].published_ns());
}

}  // namespace
}  // namespace teletact::client
