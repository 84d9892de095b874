#include "service/rpc/call_life.h"

#include <gtest/gtest.h>

#include <atomic>
#include <random>
#include <system_error>
#include <thread>
#include <vector>

#include "service/rpc/connections.h"
#include "service/rpc/status.h"

namespace teletact::service {
namespace {

using grpc::Status, grpc::StatusCode;

TEST(CallLife, EndsOnceWithTheFirstReason) {
  CallLife life;
  EXPECT_TRUE(life.status().ok());
  EXPECT_FALSE(life.ended_at());
  EXPECT_TRUE(life.end({StatusCode::RESOURCE_EXHAUSTED, "refused"}));
  EXPECT_FALSE(life.end(Status::CANCELLED));  // what the service aborted at: refused, then cancelled
  EXPECT_FALSE(life.end(Status::OK));
  EXPECT_EQ(life.status().error_message(), "refused");
  EXPECT_TRUE(life.ended());
}

TEST(CallLife, IsNotFinishedBeforeWhatIsUnderWayIsOver) {
  CallLife life;
  ASSERT_TRUE(life.begin());  // a write
  ASSERT_TRUE(life.begin());  // a thread
  EXPECT_FALSE(life.over());
  EXPECT_FALSE(life.end(Status::CANCELLED));
  EXPECT_FALSE(life.end(Status::OK));
  EXPECT_TRUE(life.over());
  EXPECT_FALSE(life.end(Status::OK));
}

TEST(CallLife, NothingBeginsAfterItsEnd) {
  CallLife life;
  ASSERT_TRUE(life.begin());
  EXPECT_FALSE(life.end(Status::OK));
  EXPECT_FALSE(life.begin());  // though it is not finished yet
  EXPECT_TRUE(life.over());
  EXPECT_FALSE(life.begin());
}

TEST(CallLife, ItsEndIsWhenItWasEndedFirst) {
  CallLife life;
  const CallLife::Clock::time_point first(std::chrono::seconds(7));
  EXPECT_TRUE(life.end(Status::OK, first));
  EXPECT_FALSE(life.end(Status::OK, first + std::chrono::seconds(1)));
  EXPECT_EQ(life.ended_at(), first);
}

TEST(CallLife, ManyThreadsFinishItOnceAndAfterAllTheyDid) {
  constexpr int kThreads = 4, kRounds = 2000;
  for (int round = 0; round < kRounds; ++round) {
    CallLife life;
    std::atomic<int> finished{0}, under_way{0}, overtaken{0};
    const auto finish = [&](bool due) {
      if (!due) return;
      ++finished;
      if (under_way > 0) ++overtaken;
    };
    std::vector<std::thread> threads;
    for (int t = 0; t < kThreads; ++t)
      threads.emplace_back([&, t] {
        std::minstd_rand random(static_cast<unsigned>(round * kThreads + t));
        for (;;) {
          if (random() % 4 == 0) finish(life.end(Status::CANCELLED));
          if (!life.begin()) return;
          ++under_way;
          if (random() % 2 == 0) std::this_thread::yield();
          --under_way;
          finish(life.over());
        }
      });
    for (auto& thread : threads) thread.join();
    ASSERT_EQ(finished, 1) << round;
    ASSERT_EQ(overtaken, 0) << round;
  }
}

TEST(Guarded, AThreadThatIsNotToBeHadIsNoFaultOfTheService) {
  const auto thrown = [](std::errc code) {
    return guarded([&]() -> Status { throw std::system_error(std::make_error_code(code)); }).error_code();
  };
  EXPECT_EQ(thrown(std::errc::resource_unavailable_try_again), StatusCode::RESOURCE_EXHAUSTED);
  EXPECT_EQ(thrown(std::errc::io_error), StatusCode::INTERNAL);
}

TEST(Allowance, IsARateWithABurst) {
  const Allowance::Clock::time_point begin(std::chrono::hours(1));
  const auto taken = [](Allowance& allowance, Allowance::Clock::time_point now) {
    int count = 0;
    while (count < 10'000 && allowance.take(now)) ++count;
    return count;
  };
  Allowance allowance(2000, 0.1);
  EXPECT_EQ(taken(allowance, begin), 200);
  EXPECT_EQ(taken(allowance, begin + std::chrono::milliseconds(10)), 20);
  EXPECT_EQ(taken(allowance, begin), 0);  // time that goes back gives nothing
  int steady = 0;
  for (int tick = 2; tick < 102; ++tick)
    steady += taken(allowance, begin + std::chrono::milliseconds(10) * tick);
  EXPECT_NEAR(steady, 2000, 1);
  EXPECT_EQ(taken(allowance, begin + std::chrono::hours(1)), 200);
  Allowance slow(0.5, 0.1);
  EXPECT_EQ(taken(slow, begin), 1);
  EXPECT_EQ(taken(slow, begin + std::chrono::milliseconds(2001)), 1);
}

}  // namespace
}  // namespace teletact::service
