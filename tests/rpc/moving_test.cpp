// A service that stops, step by step, and the one that stands by for its folder.
#include <atomic>
#include <filesystem>
#include <future>
#include <memory>

#include "service/device/cancellation.h"
#include "service/scene/errors.h"
#include "tests/rpc/estimate_client.h"
#include "tests/rpc/health.h"
#include "tests/support/finger_reader.h"

namespace teletact::service {
namespace {

namespace fs = std::filesystem;
using grpc::StatusCode;

grpc::Status list(const RunningServer& server) {
  grpc::ClientContext context;
  set_deadline(context);
  v1::ListScenesResponse scenes;
  return v1::Palpation::NewStub(server.channel())->ListScenes(&context, {}, &scenes);
}

v1::TouchOpen open_as(const std::string& session) {
  v1::TouchOpen open = Toucher::open_on("s");
  open.set_session_id(session);
  return open;
}

class Moving : public testing::Test {
 protected:
  Moving() {
    server->make_ready();
    EXPECT_TRUE(server.create(uniform_scene("s"), "", &scene).ok());
  }
  ~Moving() override { fs::remove_all(state); }
  const fs::path state = fs::temp_directory_path() / ("teletact-rpc-moving-" + std::to_string(getpid()));
  RunningServer server{"", state, {}, tissue_models(), {}, true};
  v1::Scene scene;
};

TEST_F(Moving, WhoLeavesServesOnAndIsNotReady) {
  Toucher hand(server.channel(), "s");
  v1::TouchAnswer answer;
  ASSERT_TRUE(hand.opened() && hand.touch(0.05, 0.002, &answer));
  server->leave();
  EXPECT_EQ(health_of(server, ""), kNotServing);
  EXPECT_THROW(server->core().calls.require_ready(), Error);
  ASSERT_TRUE(hand.touch(0.05, 0.002, &answer));
  EXPECT_FALSE(answer.moving());
  EXPECT_TRUE(list(server).ok());
  EXPECT_TRUE(server.create(uniform_scene("t")).ok());
  Toucher another(server.channel(), "t");
  EXPECT_TRUE(another.opened());
}

// A hand that does not know `moving` is served to the end; one that does feels the same model over there.
TEST_F(Moving, HandsAreServedWhileWhoStoodByTakesOver) {
  const auto channel = server.channel();
  const auto stub = v1::Palpation::NewStub(channel);
  Toucher hand(channel, open_as("anna"));
  v1::TouchAnswer answer;
  ASSERT_TRUE(hand.opened() && hand.touch(0.05, 0.002, &answer));
  grpc::ClientContext watching;
  FingerReader finger(*stub, watching, "s");
  v1::FingerState state_of_finger;
  ASSERT_TRUE(finger.read(&state_of_finger));
  JobTerms terms;
  terms.client = "other@local";
  std::atomic<bool> gives_way{false};  // until then the estimate has no turn
  auto busy = server->core().imaging.workers().run(terms, [&] {
    for (;;) {
      if (gives_way) check_cancelled();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
  Elastographer estimate(channel);
  upload(estimate, acquisition());
  v1::EstimateResponse progress;
  ASSERT_TRUE(estimate.read(&progress));

  RunningServer successor("", state, {}, tissue_models(), {}, true);
  auto ready = std::async(std::launch::async, [&] { successor->make_ready(); });
  EXPECT_EQ(ready.wait_for(std::chrono::milliseconds(200)), std::future_status::timeout);
  EXPECT_EQ(list(successor).error_code(), StatusCode::UNAVAILABLE);

  server->leave();
  gives_way = true;
  server->move();
  EXPECT_THROW(busy.future.get(), Error);
  EXPECT_EQ(estimate.finish().status.error_code(), StatusCode::UNAVAILABLE);
  EXPECT_EQ(finger.finish().error_code(), StatusCode::UNAVAILABLE);
  EXPECT_EQ(list(server).error_code(), StatusCode::UNAVAILABLE);
  EXPECT_EQ(server.create(uniform_scene("t")).error_code(), StatusCode::UNAVAILABLE);
  EXPECT_EQ(server.remove("s").error_code(), StatusCode::UNAVAILABLE);
  Toucher late(channel, open_as("late"));  // as a successor that was sent back to the same service
  EXPECT_FALSE(late.opened());
  EXPECT_EQ(late.finish().error_code(), StatusCode::UNAVAILABLE);

  ASSERT_EQ(ready.wait_for(std::chrono::minutes(2)), std::future_status::ready);
  ready.get();
  EXPECT_EQ(health_of(successor, ""), kServing);
  ASSERT_TRUE(hand.touch(0.05, 0.002, &answer));
  EXPECT_EQ(answer.status(), v1::TOUCH_STATUS_OK) << answer.warning();
  EXPECT_TRUE(answer.moving());
  Toucher moved(successor.channel(), open_as("anna"));
  v1::TouchAnswer after;
  ASSERT_TRUE(moved.opened() && moved.touch(0.05, 0.002, &after));
  EXPECT_FALSE(after.moving());
  EXPECT_TRUE(after.steers());
  EXPECT_EQ(after.model_version(), scene.version());
  EXPECT_EQ(after.model_version(), answer.model_version());
  EXPECT_NEAR(after.force_n(1), answer.force_n(1), 1e-6);

  server->drain();
  EXPECT_EQ(hand.finish().error_code(), StatusCode::UNAVAILABLE);
  EXPECT_TRUE(moved.touch(0.05, 0.002, &after));
  EXPECT_TRUE(successor.remove("s").ok());
}

}  // namespace
}  // namespace teletact::service
