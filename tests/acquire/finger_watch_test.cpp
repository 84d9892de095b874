#include "client/acquire/finger_watch.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <thread>

#include "client/clock/clock.h"
#include "tests/support/fake_service.h"
#include "tests/support/fault_proxy.h"

namespace teletact::client {
namespace {

using Clock = std::chrono::steady_clock;

// Waits until `met`; how long that took, or infinity after `max_s`.
template <typename Condition>
double seconds_until(const Condition& met, double max_s) {
  const auto begin = Clock::now();
  const auto waited_s = [&] { return std::chrono::duration<double>(Clock::now() - begin).count(); };
  while (waited_s() < max_s) {
    if (met()) return waited_s();
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  return INFINITY;
}

class FingerWatchTest : public ::testing::Test {
 protected:
  FingerWatchTest() {
    server.create_scene("s");
    server.palpation.set_finger(true, 0.03, 0);
  }
  static bool stands_at(const FingerWatch& watch, double x_m) {
    return watch.motion(monotonic_ns()).x_m == x_m;
  }
  test::FakeServer server;
};

TEST_F(FingerWatchTest, GoesOnAfterAnEndThatMayPass) {
  FingerWatch watch(server.address(), {}, "s");
  using enum grpc::StatusCode;
  double x_m = 0.03;
  for (const grpc::StatusCode code :
       {UNAVAILABLE, INTERNAL, UNKNOWN, RESOURCE_EXHAUSTED, DEADLINE_EXCEEDED}) {
    ASSERT_LT(seconds_until([&] { return stands_at(watch, x_m); }, 5), 5) << code;
    const int watches = server.palpation.watches;
    server.palpation.refusal = code;
    ASSERT_LT(seconds_until([&] { return server.palpation.watches > watches; }, 5), 5) << code;
    server.palpation.set_finger(true, x_m += 0.001, 0);
  }
  EXPECT_EQ(watch.failure(), "");
  // Of a stream whose end comes while something is written, gRPC (1.51) may say CANCELLED instead: then the
  // next one is refused, too.
  const auto ended = [&] {
    if (watch.failure().empty() && server.palpation.refusal == OK) server.palpation.refusal = ABORTED;
    return !watch.failure().empty();
  };
  EXPECT_LT(seconds_until(ended, 10), 10);
  EXPECT_NE(watch.failure().find("ABORTED"), std::string::npos) << watch.failure();
}

// GIVEN a connection that goes half-open WHEN the finger moves THEN the watch notices the silence and sees it
// on a new connection.
TEST_F(FingerWatchTest, AStreamThatSaysNothingIsOpenedAgainElsewhere) {
  test::FaultProxy proxy(server.address());
  FingerWatch watch(proxy.address(), {}, "s", 0, 0.3);
  ASSERT_LT(seconds_until([&] { return stands_at(watch, 0.03); }, 5), 5);
  proxy.play({.kind = test::FaultEvent::Kind::kHalfOpen});
  server.palpation.set_finger(true, 0.05, 0);
  EXPECT_LT(seconds_until([&] { return stands_at(watch, 0.05); }, 20), 20);
  EXPECT_EQ(watch.failure(), "");
  EXPECT_GE(proxy.connections(), 2u);
}

TEST_F(FingerWatchTest, RepeatedStateKeepsThePosition) {
  server.palpation.set_finger(true, 0.03, 0.5);
  FingerWatch watch(server.address(), {}, "s");
  ASSERT_LT(seconds_until([&] { return watch.motion(monotonic_ns()).x_m >= 0.0799; }, 5), 5);
  // What has gone quiet stands: 0.1 s of its speed is as far as it is taken to have gone.
  constexpr std::int64_t kTenSecondsNs = 10'000'000'000;
  EXPECT_NEAR(watch.motion(monotonic_ns() + kTenSecondsNs).x_m, 0.03 + 0.1 * 0.5, 1e-9);
  const int told = server.palpation.told;
  server.palpation.repeat_finger();
  double min_m = 1;
  const auto repeated = [&] {
    min_m = std::min(min_m, watch.motion(monotonic_ns()).x_m);
    return server.palpation.told > told;
  };
  ASSERT_LT(seconds_until(repeated, 5), 5);
  seconds_until([&] { return repeated() && false; }, 0.03);
  EXPECT_GE(min_m, 0.0799);
}

// GIVEN a finger that has left WHEN the service goes on saying that nobody is there THEN it left when it did.
TEST_F(FingerWatchTest, AFingerThatIsAwayLeavesOnce) {
  server.palpation.set_finger(false, 0.03, 0);
  FingerWatch watch(server.address(), {}, "s");
  ASSERT_LT(seconds_until([&] { return stands_at(watch, 0.03); }, 5), 5);
  EXPECT_FALSE(watch.gone_since_ns()) << "it was never there";
  const auto leave = [&](double x_m) {
    server.palpation.set_finger(false, x_m, 0);
    return seconds_until([&] { return stands_at(watch, x_m); }, 5) < 5;
  };
  server.palpation.set_finger(true, 0.04, 0);
  ASSERT_LT(seconds_until([&] { return stands_at(watch, 0.04); }, 5), 5);
  EXPECT_FALSE(watch.gone_since_ns());
  ASSERT_TRUE(leave(0.05));
  const auto since_ns = watch.gone_since_ns();
  ASSERT_TRUE(since_ns);
  ASSERT_TRUE(leave(0.06));
  EXPECT_EQ(watch.gone_since_ns(), since_ns);
}

// GIVEN a finger that moves WHEN nothing more is heard of it THEN it is carried on for a tenth of a second,
// no more.
TEST_F(FingerWatchTest, AFingerThatStallsIsNotCarriedOnForLong) {
  server.palpation.set_finger(true, 0.03, 0.5);
  FingerWatch watch(server.address(), {}, "s");
  ASSERT_LT(seconds_until([&] { return watch.motion(monotonic_ns()).present; }, 5), 5);
  constexpr std::int64_t kSecondNs = 1'000'000'000;
  for (const std::int64_t later_ns : {kSecondNs / 2, 10 * kSecondNs, 1000 * kSecondNs})
    EXPECT_NEAR(watch.motion(monotonic_ns() + later_ns).x_m, 0.03 + 0.5 * 0.1, 1e-9) << later_ns;
}

}  // namespace
}  // namespace teletact::client
