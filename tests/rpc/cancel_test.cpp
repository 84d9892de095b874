// Calls that are ended from both sides at once: refused and cancelled, past their deadline before they are
// served, ended by the service while the client gives up.
#include <atomic>
#include <future>
#include <thread>
#include <vector>

#include "tests/rpc/estimate_client.h"
#include "tests/support/finger_reader.h"

namespace teletact::service {
namespace {

enum class End { kCancelAtOnce, kShortDeadline, kHalfClose, kWriteThenCancel };
constexpr End kEnds[] = {End::kCancelAtOnce, End::kShortDeadline, End::kHalfClose, End::kWriteThenCancel};

// One call of a stream, begun with `first` and ended in that way, whatever the service says meanwhile.
template <class Begin, class Request, class Response>
void begin_and_end(Begin begin, const Request& first, Response, End end) {
  grpc::ClientContext context;
  context.set_deadline(std::chrono::system_clock::now() + (end == End::kShortDeadline
                                                               ? std::chrono::milliseconds(1)
                                                               : std::chrono::milliseconds(60'000)));
  const auto stream = begin(&context);
  if (end != End::kCancelAtOnce) stream->Write(first);
  if (end == End::kHalfClose) stream->WritesDone();
  if (end == End::kCancelAtOnce || end == End::kWriteThenCancel) context.TryCancel();
  Response response;
  while (stream->Read(&response)) {
  }
  stream->Finish();
}

void try_touch(v1::Palpation::Stub& stub, const std::string& scene, End end) {
  v1::TouchRequest first;
  *first.mutable_open() = Toucher::open_on(scene);
  begin_and_end([&](auto* context) { return stub.Touch(context); }, first, v1::TouchResponse(), end);
}

void try_watch(v1::Palpation::Stub& stub, const std::string& scene, End end) {
  v1::WatchFingerRequest first;
  first.set_scene_id(scene);
  begin_and_end([&](auto* context) { return stub.WatchFinger(context); }, first, v1::FingerState(),
                end == End::kHalfClose ? End::kWriteThenCancel : end);
}

// Several clients at once, each with a connection of its own.
void try_all(RunningServer& server, const std::string& scene, int tries) {
  constexpr int kClients = 4;
  std::vector<std::thread> clients;
  for (int c = 0; c < kClients; ++c)
    clients.emplace_back([&, c] {
      const auto stub = v1::Palpation::NewStub(server.channel());
      for (int k = c; k < tries; k += kClients) {
        const End end = kEnds[(k / kClients) % 4];
        if (k % 8 == 7)
          try_watch(*stub, scene, end);
        else
          try_touch(*stub, scene, end);
      }
    });
  for (auto& client : clients) client.join();
}

// Clients that try one thing after the other on scene "s" for as long as this lives.
class Trying {
 public:
  explicit Trying(RunningServer& server) {
    for (int c = 0; c < 4; ++c)
      clients_.emplace_back([&server, c](const std::stop_token& stop) {
        const auto stub = v1::Palpation::NewStub(server.channel());
        for (int k = c; !stop.stop_requested(); ++k)
          k % 3 == 0 ? try_watch(*stub, "s", kEnds[k % 4]) : try_touch(*stub, "s", kEnds[k % 4]);
      });
  }

 private:
  std::vector<std::jthread> clients_;
};

TEST(Cancelled, RefusedTouchIsFinishedOnce) {
  // GIVEN a service all of whose places are taken, by clients that are served
  Limits limits;
  limits.max_touch_streams = 64;  // fewer than calls of one connection
  RunningServer server("", "", limits);
  server->make_ready();
  ASSERT_TRUE(server.create(uniform_scene("s")).ok());
  const auto channel = server.channel();
  std::vector<std::unique_ptr<Toucher>> held;
  for (std::size_t k = 0; k < limits.max_touch_streams; ++k) {
    held.push_back(std::make_unique<Toucher>(channel, Toucher::open_on("s"), "client-" + std::to_string(k)));
    ASSERT_TRUE(held.back()->opened()) << k;
  }
  // WHEN others try, and give up at once
  try_all(server, "s", 6000);
  // THEN the service lives, and who was served still is
  v1::TouchAnswer answer;
  for (const auto& toucher : held) ASSERT_TRUE(toucher->touch(0.05, 0.002, &answer));
  held.clear();
  server.expect_all_calls_end();
}

// Polls for far longer than the busiest machine takes.
template <class Condition>
bool soon(Condition condition) {
  for (int k = 0; k < 2000 && !condition(); ++k) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  return condition();
}

TEST(Cancelled, WaitingCallLeavesTheQueueAtOnce) {
  std::atomic<bool> enough{false};
  RunningServer server;
  server->make_ready();
  // GIVEN an imaging plane that works for another and does not look up
  std::promise<void> begun;
  JobTerms terms;
  terms.client = "other";
  const auto busy = server->core().imaging.workers().run(terms, [&] {
    begun.set_value();
    while (!enough) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  });
  const std::shared_ptr<void> let_go(nullptr, [&](void*) { enough = true; });
  begun.get_future().wait();
  const auto held = [&] { return server->core().memory->held(Place::kHost, "anna@local"); };
  const auto stub = v1::Palpation::NewStub(server.channel());
  // WHEN a client asks for more scenes than may wait, and gives up each
  for (std::size_t k = 0; k <= Schedule::kMaxWaitingPerClient; ++k) {
    grpc::ClientContext context;
    set_deadline(context);
    context.AddMetadata("teletact-client", "anna");
    grpc::Status status;
    std::thread asking([&] {
      v1::Scene scene;
      status = stub->CreateScene(&context, uniform_scene("s" + std::to_string(k)), &scene);
    });
    const bool waited = soon([&] { return held() > 0; });
    context.TryCancel();
    asking.join();
    ASSERT_TRUE(waited) << k << ": " << status.error_message();
    EXPECT_EQ(status.error_code(), grpc::StatusCode::CANCELLED);
    // THEN its place and its bytes are free before its turn comes
    ASSERT_TRUE(soon([&] { return held() == 0; })) << k;
  }
  ASSERT_TRUE(soon([&] { return server->core().calls.count() == 0; }));
}

TEST(Cancelled, CallsOfAServiceThatStartsAreFinishedOnce) {
  RunningServer server;  // not ready
  try_all(server, "s", 2000);
  server->make_ready();
  ASSERT_TRUE(server.create(uniform_scene("s")).ok());
  Toucher toucher(server.channel(), "s");
  EXPECT_TRUE(toucher.opened());
}

TEST(Cancelled, CallsOfAServiceThatDrainsAreFinishedOnce) {
  for (int round = 0; round < 3; ++round) {
    RunningServer server;
    server->make_ready();
    ASSERT_TRUE(server.create(uniform_scene("s")).ok());
    {
      const Trying clients(server);
      std::this_thread::sleep_for(std::chrono::milliseconds(50 + 50 * round));
      server->drain();
    }
    EXPECT_EQ(server->core().calls.count(), 0U);
  }
}

TEST(Cancelled, StreamsWhoseSceneIsDeletedAreFinishedOnce) {
  RunningServer server;
  server->make_ready();
  {
    const Trying clients(server);
    for (int round = 0; round < 20; ++round) {
      ASSERT_TRUE(server.create(uniform_scene("s")).ok());
      EXPECT_TRUE(server.remove("s").ok());
    }
  }
  server.expect_all_calls_end();
}

}  // namespace
}  // namespace teletact::service
