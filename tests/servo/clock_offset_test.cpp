#include "client/servo/clock_offset.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace teletact::client {
namespace {

constexpr std::int64_t kStartNs = 5'000'000'000;

std::int64_t ns(double seconds) {
  return std::llround(seconds * 1e9);
}

// Their clock: ours plus an offset, running fast by `drift`.
struct OtherClock {
  double offset_s = 0, drift = 0;
  std::int64_t at(std::int64_t our_ns) const {
    return our_ns + ns(offset_s + drift * 1e-9 * static_cast<double>(our_ns - kStartNs));
  }
  double offset_at_s(std::int64_t our_ns) const { return 1e-9 * static_cast<double>(at(our_ns) - our_ns); }
};

// An exchange that leaves at `sent_ns` and takes so long on each way.
StampExchange exchange(const OtherClock& clock, std::int64_t sent_ns, double up_s, double stay_s,
                       double down_s) {
  StampExchange made;
  made.sent_ns = sent_ns;
  made.arrived_ns = clock.at(sent_ns + ns(up_s));
  made.left_ns = clock.at(sent_ns + ns(up_s + stay_s));
  made.received_ns = sent_ns + ns(up_s + stay_s + down_s);
  return made;
}

TEST(ClockOffset, EqualWaysGiveTheOffsetAndTheRoundTrip) {
  // GIVEN a clock 1234.5 s ahead, 20 ms each way and a service that computes for 7 ms
  const OtherClock theirs{.offset_s = 1234.5};
  ClockOffset offset;
  EXPECT_FALSE(offset.known());
  EXPECT_TRUE(std::isinf(offset.error_s(kStartNs)));
  // WHEN one answer is back
  const StampExchange made = exchange(theirs, kStartNs, 0.02, 0.007, 0.02);
  offset.add(made);
  // THEN computing is no part of the round trip
  EXPECT_TRUE(offset.known());
  EXPECT_NEAR(offset.round_trip_s(), 0.04, 1e-8);
  EXPECT_NEAR(offset.offset_s(made.received_ns), 1234.5, 1e-8);
  EXPECT_NEAR(offset.error_s(made.received_ns), 0.02, 1e-8);
}

TEST(ClockOffset, UnequalWaysAreWithinTheBound) {
  for (const double up_s : {0.0, 0.001, 0.05, 0.3}) {
    const OtherClock theirs{.offset_s = -3};
    ClockOffset offset;
    const StampExchange made = exchange(theirs, kStartNs, up_s, 0, 0.3 - up_s);
    offset.add(made);
    EXPECT_LE(std::abs(offset.offset_s(made.received_ns) + 3), offset.error_s(made.received_ns) + 1e-8);
  }
}

TEST(ClockOffset, QuickestExchangeOfAJitteryLinkCounts) {
  // GIVEN 10 ms each way and up to 300 ms of queueing, 100 answers a second, clocks drifting by 60 ppm
  const OtherClock theirs{.offset_s = 40, .drift = 60e-6};
  ClockOffset offset;
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> jitter(0, 0.3);
  double worst_s = 0, naive_s = 0;
  for (int k = 0; k < 12'000; ++k) {
    const StampExchange made =
        exchange(theirs, kStartNs + ns(0.01 * k), 0.01 + jitter(random), 0.001, 0.01 + jitter(random));
    offset.add(made);
    const double truth_s = theirs.offset_at_s(made.received_ns);
    const double error_s = std::abs(offset.offset_s(made.received_ns) - truth_s);
    ASSERT_LE(error_s, offset.error_s(made.received_ns) + 1e-7) << k;
    if (k < 200) continue;
    worst_s = std::max(worst_s, error_s);
    const double one_s =
        0.5e-9 * static_cast<double>(made.arrived_ns - made.sent_ns + made.left_ns - made.received_ns);
    naive_s = std::max(naive_s, std::abs(one_s - truth_s));
  }
  // THEN it is known ten times better than from any one answer
  EXPECT_LE(worst_s, 0.02);
  EXPECT_GE(naive_s, 0.1);
  EXPECT_NEAR(offset.round_trip_s(), 0.32, 0.15);
  std::printf("[ clock ] worst error %.4f s over 2 minutes; of single answers %.4f s\n", worst_s, naive_s);
}

TEST(ClockOffset, FollowsADriftingClock) {
  // GIVEN one perfect exchange, then 60 s of slower ones while the clocks drift apart by 90 ppm
  const OtherClock theirs{.drift = 90e-6};
  ClockOffset offset;
  offset.add(exchange(theirs, kStartNs, 0, 0, 0));
  double now_error_s = 0;
  for (int k = 1; k <= 6000; ++k) {
    const StampExchange made = exchange(theirs, kStartNs + ns(0.01 * k), 0.0004, 0, 0.0004);
    offset.add(made);
    now_error_s = std::abs(offset.offset_s(made.received_ns) - theirs.offset_at_s(made.received_ns));
    ASSERT_LE(now_error_s, offset.error_s(made.received_ns) + 1e-7);
  }
  EXPECT_LE(now_error_s, 1e-3);  // 5.4 ms had the first one been kept
}

TEST(ClockOffset, AfterALongSilenceOnlyWhatIsNewCounts) {
  const OtherClock before{.offset_s = 1}, after{.offset_s = 2};
  ClockOffset offset;
  offset.add(exchange(before, kStartNs, 0.001, 0, 0.001));
  const std::int64_t later_ns = kStartNs + ns(1000);
  offset.add(exchange(after, later_ns, 0.1, 0, 0.1));
  EXPECT_NEAR(offset.offset_s(later_ns + ns(0.2)), 2, 1e-8);
}

TEST(ClockOffset, ImpossibleStampsAreIgnored) {
  ClockOffset offset;
  offset.add({.sent_ns = 100, .arrived_ns = 50, .left_ns = 40, .received_ns = 200});   // left before it came
  offset.add({.sent_ns = 100, .arrived_ns = 0, .left_ns = 1000, .received_ns = 200});  // stayed too long
  offset.add({.sent_ns = 300, .arrived_ns = 0, .left_ns = 0, .received_ns = 200});     // back before it went
  EXPECT_FALSE(offset.known());
}

TEST(ClockOffset, ARestartedServiceIsAnotherClock) {
  ClockOffset offset;
  offset.add(exchange({.offset_s = 5}, kStartNs, 0.001, 0, 0.001));
  offset.reset();
  EXPECT_FALSE(offset.known());
  const StampExchange made = exchange({.offset_s = -7}, kStartNs + ns(0.1), 0.5, 0, 0.5);
  offset.add(made);
  EXPECT_NEAR(offset.offset_s(made.received_ns), -7, 1e-8);
}

}  // namespace
}  // namespace teletact::client
