// A touch plane that has more to do than it can refuses the next stream, says why and when to come again, and
// leaves those alone that it has admitted.
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <thread>
#include <vector>

#include "service/rpc/call_metadata.h"
#include "tests/rpc/running_server.h"

namespace teletact::service {
namespace {

using namespace std::chrono_literals;

// Somebody who is always due, and whose turns are long.
class Endless final : public TouchTurns {
 public:
  Done turn(TouchQueue::Clock::duration period) override {
    kept = period;
    std::this_thread::sleep_for(5ms);
    return {leave ? TouchQueue::Time::max() : TouchQueue::Clock::now(), true, leave};
  }
  void left() override { gone = true; }
  std::atomic<bool> leave{false}, gone{false};
  std::atomic<TouchQueue::Clock::duration> kept{};  // period of its last turn
};

template <class Condition>
bool soon(Condition condition) {
  for (int k = 0; k < 4000 && !condition(); ++k) std::this_thread::sleep_for(5ms);
  return condition();
}

class Load : public OnOneServer {
 protected:
  static constexpr const char* kBusy = "busy";
  static void SetUpTestSuite() {
    Limits limits;
    limits.touch_workers = 2;
    serve(limits);
  }
  grpc::Status opened_by(const char* client) {
    Toucher touching(channel, Toucher::open_on("s"), client);
    touching.opened();
    return touching.finish();
  }
  void expect_answered(Toucher& touching) {
    v1::TouchAnswer answer;
    EXPECT_TRUE(touching.send(0.05, 0.002) && touching.read(&answer));
  }
};

TEST_F(Load, OneMoreThanCanBeServedIsRefusedAndTheAdmittedAreNot) {
  // GIVEN a client that is answered, and that leaves the workers no rest
  Toucher admitted(channel, Toucher::open_on("s"), kBusy);
  ASSERT_TRUE(admitted.opened());
  expect_answered(admitted);
  const TouchQueue::Principal busy{client_name(kBusy, "unix:"), 1};
  TouchWorkers& touch = (*server)->core().touch;
  std::array<Endless, 30> endless;
  std::vector<TouchWorkers::Id> ids;
  for (Endless& stream : endless) {
    ids.push_back(touch.join(busy, 1ms, stream));
    touch.wake(ids.back(), TouchQueue::Clock::now());
  }
  ASSERT_TRUE(soon([&] { return touch.overload(busy, TouchQueue::kLongTurns).has_value(); }));
  // WHEN it opens one more THEN it is told the load, and when to come again
  const grpc::Status refused = opened_by(kBusy);
  expect_refused(refused, grpc::StatusCode::RESOURCE_EXHAUSTED, "min_touch_rate_hz");
  expect_refused(refused, grpc::StatusCode::RESOURCE_EXHAUSTED, "try again");
  // THEN its long turns come as seldom as they may
  EXPECT_TRUE(soon(
      [&] { return std::ranges::all_of(endless, [](const Endless& e) { return e.kept.load() == 50ms; }); }));
  // THEN what was admitted is answered as agreed, since its turns are short, and so is another client
  v1::TouchAnswer answer;
  ASSERT_TRUE(admitted.send(0.05, 0.002) && admitted.read(&answer));
  EXPECT_DOUBLE_EQ(answer.period_s(), 0.001);
  Toucher other(channel, Toucher::open_on("s"), "other");
  ASSERT_TRUE(other.opened());
  expect_answered(other);
  // THEN it has room again once it does less
  for (Endless& stream : endless) stream.leave = true;
  EXPECT_TRUE(
      soon([&] { return std::ranges::all_of(endless, [](const Endless& e) { return bool{e.gone}; }); }));
  EXPECT_TRUE(soon([&] { return opened_by(kBusy).ok(); }));
  for (Toucher* touching : {&admitted, &other}) EXPECT_TRUE(touching->finish().ok());
}

}  // namespace
}  // namespace teletact::service
