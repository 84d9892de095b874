// The operator side and the real service, and a link between them that breaks: what is felt, and how soon
// touch is back.
#include "tests/integration/faulty_link.h"

namespace teletact {
namespace {

using Kind = test::FaultEvent::Kind;

TEST_F(Faults, AStallAt100HzFadesPast50MillisecondsAndIsZeroPast150) {
  double short_s = 0, long_s = 0, back_s = 0;
  touch(0.01, [&] {
    short_s = test::now_s();
    proxy.play({.kind = Kind::kStall, .seconds = 0.09});
    sleep_s(0.6);
    long_s = test::now_s();
    proxy.play({.kind = Kind::kStall, .seconds = 0.5});
    sleep_s(0.5);
    back_s = test::now_s();
    sleep_s(2.0);
  });
  // GIVEN a stall of 90 ms THEN the force fades a little and comes back, without a pause
  const auto stalled = between(short_s, short_s + 0.4);
  const double faded_n = std::min_element(stalled.begin(), stalled.end(), [](const auto& a, const auto& b) {
                           return a.size_n() < b.size_n();
                         })->size_n();
  EXPECT_LT(faded_n, 0.85 * force_before_n(short_s));
  EXPECT_GT(longest_silence_s(stalled), 0.07);
  // A busy machine can make more of it: until then, that is.
  std::size_t kept = 0;
  for (const test::TouchTick& tick : stalled) {
    if (tick.silence_s > 0.14) break;
    ++kept;
    ASSERT_GT(tick.size_n(), 0) << tick.silence_s;
    ASSERT_EQ(tick.state, ServoState::kEnabled) << tick.silence_s;
  }
  EXPECT_GT(kept, 50u);
  // GIVEN one of 500 ms THEN it is zero, and comes back when resumed out of contact
  expect_faded(long_s, back_s);
  EXPECT_LE(recording.answer_after_s(back_s) - back_s, kResumeS);
  EXPECT_TRUE(felt_again_after(back_s));
}

TEST_F(Faults, At10HzTheSameLimitsAreScaled) {
  double stalled_s = 0, back_s = 0;
  touch(0.1, [&] {
    sleep_s(0.5);
    stalled_s = test::now_s();
    proxy.play({.kind = Kind::kStall, .seconds = 1.3});
    sleep_s(1.3);
    back_s = test::now_s();
    sleep_s(2.5);
  });
  expect_faded(stalled_s, back_s);
  for (const test::TouchTick& tick : between(stalled_s - 0.5, stalled_s))
    EXPECT_EQ(tick.state, ServoState::kEnabled) << "0.1 s between answers is no silence at 10 Hz";
  EXPECT_LE(recording.answer_after_s(back_s) - back_s, kResumeS);
  EXPECT_TRUE(felt_again_after(back_s));
}

TEST_F(Faults, BrokenStreamsReopenWithinASecond) {
  std::vector<double> begun_s;
  const auto break_link = [&](test::FaultEvent event) {
    begun_s.push_back(test::now_s());
    proxy.play(event);
    sleep_s(3);
  };
  touch(0.01, [&] {
    break_link({.kind = Kind::kReset});
    break_link({.kind = Kind::kHalfOpen});
    break_link({.kind = Kind::kHold, .seconds = 1.5});  // then says what it had to say, beside the new stream
  });
  for (const double fault_s : begun_s) {
    EXPECT_GT(force_before_n(fault_s), 0.3) << "not pressed before the fault";
    // New connections pass at once: the link is back the moment it breaks.
    const double again_s = recording.answer_after_s(fault_s + 0.03) - fault_s;
    std::printf("[ resume] answers %.3f s after the fault\n", again_s);
    EXPECT_LE(again_s, kResumeS);
    EXPECT_TRUE(felt_again_after(fault_s + 0.5));
  }
  EXPECT_EQ(summary.link.streams, 4u);
}

TEST_F(Faults, ALongOutageIsOverWithinASecondOfTheLinkBeingBack) {
  double back_s = 0;
  touch(0.01, [&] {
    proxy.play({.kind = Kind::kStall, .seconds = 5});
    sleep_s(5);
    back_s = test::now_s();
    sleep_s(2);
  });
  const double again_s = recording.answer_after_s(back_s) - back_s;
  std::printf("[ resume] answers %.3f s after the link was back\n", again_s);
  EXPECT_LE(again_s, kResumeS);
  EXPECT_TRUE(felt_again_after(back_s));
}

}  // namespace
}  // namespace teletact
