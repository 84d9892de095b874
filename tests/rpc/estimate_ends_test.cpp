// Estimates that end before they are done: no memory, a client that goes, a scene that is deleted.
#include <spdlog/sinks/base_sink.h>
#include <spdlog/spdlog.h>

#include <chrono>
#include <future>
#include <memory>
#include <mutex>
#include <string_view>
#include <thread>

#include "tests/rpc/estimates.h"
#include "tests/support/allocation/allocation_count.h"

namespace teletact::service {
namespace {

// While it lives whoever logs that an estimate is done waits: its last message so far has been written then.
class SlowLog {
 public:
  SlowLog() {
    spdlog::set_default_logger(std::make_shared<spdlog::logger>("slow", std::make_shared<Sink>()));
    spdlog::set_level(spdlog::level::info);
  }
  ~SlowLog() {
    spdlog::set_level(level_);
    spdlog::set_default_logger(usual_);
  }
  SlowLog(const SlowLog&) = delete;
  SlowLog& operator=(const SlowLog&) = delete;

 private:
  struct Sink final : spdlog::sinks::base_sink<std::mutex> {
    void sink_it_(const spdlog::details::log_msg& message) override {
      const std::string_view text(message.payload.data(), message.payload.size());
      if (text.starts_with("event=estimate_done"))
        std::this_thread::sleep_for(std::chrono::milliseconds(300));
    }
    void flush_() override {}
  };
  const std::shared_ptr<spdlog::logger> usual_ = spdlog::default_logger();
  const spdlog::level::level_enum level_ = spdlog::get_level();
};

TEST_F(Estimates, AnswerWithoutMemoryEndsItsCallAlone) {
  v1::Acquisition a = acquisition();
  a.add_maps("youngs_modulus");
  const auto try_again = [&] { return estimate(a, pair().pre, pair().post); };
  const Outcome whole = try_again();
  ASSERT_EQ(whole.maps.size(), 1U) << whole.status.error_message();
  {
    const test::NoRoomFor answer(whole.maps[0].values().data().size() + 1);  // as a string holds it
    // Told by whoever wrote the last message, and by who worked where nothing is being written.
    expect_refused(try_again(), grpc::StatusCode::RESOURCE_EXHAUSTED, "out of memory");
    const SlowLog slow;
    expect_refused(try_again(), grpc::StatusCode::RESOURCE_EXHAUSTED, "out of memory");
  }
  EXPECT_TRUE(try_again().status.ok());
}

TEST_F(Estimates, ClientThatDiesMidUploadLeavesNothing) {
  for (int k = 0; k < 20; ++k) {
    Elastographer call(channel);
    call.send(acquisition("scene"));
    call.send(v1::FRAME_KIND_PRE, 0, pair().pre.substr(0, 100'000));
    call.context().TryCancel();
    EXPECT_EQ(call.finish().status.error_code(), grpc::StatusCode::CANCELLED);
  }
  server->expect_all_calls_end();
  EXPECT_EQ(scene().version(), 0U);
  EXPECT_TRUE(estimate(acquisition("scene"), pair().pre, pair().post).status.ok());
}

TEST_F(Estimates, CancelledCallPublishesNothing) {
  // The worker is held until the call is cancelled: no matter how fast this machine is.
  std::promise<void> release;
  (*server)->core().imaging.workers().run({}, [&] { release.get_future().wait(); });
  Elastographer late(channel);
  upload(late, acquisition("scene"));
  late.context().TryCancel();
  EXPECT_EQ(late.finish().status.error_code(), grpc::StatusCode::CANCELLED);
  server->expect_all_calls_end();  // it does not wait for the worker
  release.set_value();
  (*server)->core().imaging.workers().run({}, [] {}).future.get();
  EXPECT_EQ(scene().version(), 0U);
}

TEST_F(Estimates, SceneThatIsDeletedMeanwhileAbortsThePublication) {
  v1::CreateSceneRequest request;
  request.set_scene_id("doomed");
  request.mutable_geometry()->add_size_m(0.1);
  request.mutable_geometry()->add_size_m(0.02);
  ASSERT_TRUE(server->create(request).ok());
  std::promise<void> release;  // the worker is held until the scene is gone
  (*server)->core().imaging.workers().run({}, [&] { release.get_future().wait(); });
  Elastographer call(channel);
  upload(call, acquisition("doomed"));
  v1::EstimateResponse received;
  EXPECT_TRUE(call.read(&received));
  EXPECT_TRUE(server->remove("doomed").ok());
  release.set_value();
  expect_refused(call.finish(), grpc::StatusCode::ABORTED, "doomed was deleted");
}

}  // namespace
}  // namespace teletact::service
