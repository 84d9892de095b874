// The threads that work on touch streams.
#include "service/touch_plane/touch_workers.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <vector>

namespace teletact::service {
namespace {

using namespace std::chrono_literals;
using Clock = TouchWorkers::Clock;

Limits with_workers(std::uint64_t workers) {
  Limits limits;
  limits.touch_workers = workers;
  return limits;
}

template <class Condition>
bool soon(Condition condition) {
  for (int k = 0; k < 20000 && !condition(); ++k) std::this_thread::sleep_for(1ms);
  return condition();
}

// Counts its turns. `work` is a turn; it leaves once it was told to.
class Counted final : public TouchTurns {
 public:
  explicit Counted(std::function<void()> work = [] {}) : work_(std::move(work)) {}
  Done turn(Clock::duration) override {
    overlapped = overlapped || working_.exchange(true);
    work_();
    ++turns;
    working_ = false;
    return {Clock::time_point::max(), true, leave.load()};
  }
  void left() override { ++times_left; }

  std::atomic<bool> leave{false}, overlapped{false};
  std::atomic<int> turns{0}, times_left{0};

 private:
  std::function<void()> work_;
  std::atomic<bool> working_{false};
};

void end(TouchWorkers& workers, TouchWorkers::Id id, Counted& stream) {
  stream.leave = true;
  workers.wake(id, Clock::now());
  ASSERT_TRUE(soon([&] { return stream.times_left == 1; }));
}

TEST(TouchWorkers, EveryWakeIsFollowedByATurnAndNoTwoOverlap) {
  TouchWorkers workers(with_workers(4));
  constexpr int kStreams = 8, kWakes = 2000;
  std::atomic<int> woken[kStreams]{};
  std::vector<std::unique_ptr<Counted>> streams;
  std::vector<TouchWorkers::Id> ids;
  std::atomic<int> seen[kStreams]{};
  for (int k = 0; k < kStreams; ++k) {
    streams.push_back(std::make_unique<Counted>([&, k] { seen[k] = woken[k].load(); }));
    ids.push_back(workers.join({k % 2 ? "odd" : "even"}, 1ms, *streams.back()));
  }
  std::vector<std::thread> wakers;
  for (int half = 0; half < 2; ++half)
    wakers.emplace_back([&, half] {
      for (int n = 0; n < kWakes; ++n)
        for (int k = half; k < kStreams; k += 2) {
          ++woken[k];
          workers.wake(ids[static_cast<std::size_t>(k)], Clock::now() + (n % 3) * 10us);
        }
    });
  for (std::thread& waker : wakers) waker.join();
  for (int k = 0; k < kStreams; ++k) {
    Counted& stream = *streams[static_cast<std::size_t>(k)];
    EXPECT_TRUE(soon([&] { return seen[k] == kWakes; })) << k;
    end(workers, ids[static_cast<std::size_t>(k)], stream);
    EXPECT_FALSE(stream.overlapped) << k;
  }
}

TEST(TouchWorkers, OneIsWokenAtItsTimeWhileNobodyCalls) {
  TouchWorkers workers(with_workers(2));
  Counted late, early;
  const auto first = workers.join({"a"}, 1ms, late), second = workers.join({"a"}, 1ms, early);
  const auto begun = Clock::now();
  workers.wake(first, begun + 200ms);
  workers.wake(second, begun + 20ms);
  EXPECT_TRUE(soon([&] { return early.turns == 1; }));
  EXPECT_GE(Clock::now() - begun, 20ms);
  EXPECT_TRUE(soon([&] { return late.turns == 1; }));
  EXPECT_GE(Clock::now() - begun, 200ms);
  end(workers, first, late), end(workers, second, early);
}

// As while a contact is solved for by conjugate gradients.
TEST(TouchWorkers, ShortTurnsDoNotWaitForLongOnes) {
  TouchWorkers workers(with_workers(2));
  std::atomic<bool> hold{false};
  std::atomic<int> held{0};
  const auto take_long = [&] {
    ++held;
    std::this_thread::sleep_for(5ms);
    while (hold) std::this_thread::sleep_for(1ms);
    --held;
  };
  Counted quick, slow(take_long), slower(take_long);
  const auto quick_id = workers.join({"a"}, 1ms, quick);
  const std::vector<TouchWorkers::Id> slow_ids{workers.join({"b"}, 1ms, slow),
                                               workers.join({"c"}, 1ms, slower)};
  const auto turn_of = [&](TouchWorkers::Id id, Counted& stream) {
    const int before = stream.turns;
    workers.wake(id, Clock::now());
    return soon([&] { return stream.turns > before; });
  };
  for (int known = 0; known < 3; ++known)
    ASSERT_TRUE(turn_of(quick_id, quick) && turn_of(slow_ids[0], slow) && turn_of(slow_ids[1], slower));
  hold = true;
  for (const auto id : slow_ids) workers.wake(id, Clock::now());
  ASSERT_TRUE(soon([&] { return held == 1; }));
  for (int k = 0; k < 10; ++k) EXPECT_TRUE(turn_of(quick_id, quick)) << k;
  EXPECT_EQ(held, 1);
  hold = false;
  end(workers, quick_id, quick), end(workers, slow_ids[0], slow), end(workers, slow_ids[1], slower);
}

}  // namespace
}  // namespace teletact::service
