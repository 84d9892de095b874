// What a session adds up to.
#include "client/session/figures.h"

#include <gtest/gtest.h>

namespace teletact::client {
namespace {

// Ticks of one state, every 10 ms.
void spend(TickStatistics& ticks, ServoState state, double seconds) {
  constexpr double kStepS = 0.01;
  ServoTick tick = ticks.last();
  tick.state = state;
  for (double spent_s = 0; spent_s < seconds - kStepS / 2; spent_s += kStepS) {
    tick.time_ns += 10'000'000;
    ticks.add(tick);
  }
}

TEST(Figures, OnlyAnOutageThatLastsIsTakenOffTheDuration) {
  constexpr double kLostS = 5, kStepS = 0.01;
  TickStatistics ticks;
  for (int outage = 0; outage < 6; ++outage) {
    spend(ticks, ServoState::kEnabled, 2);
    spend(ticks, ServoState::kPaused, 1);
  }
  EXPECT_GT(ticks.lost_s(), kLostS);
  EXPECT_NEAR(spent_s(ticks, kLostS), 12, 2 * kStepS) << "short ones are made up for";
  spend(ticks, ServoState::kPaused, 4.5);
  EXPECT_NEAR(spent_s(ticks, kLostS), 12 + 6 + 4.5, 2 * kStepS) << "one of 5.5 s, and those before it";
}

TEST(Figures, AFingerThatRestsIsAnsweredOnce) {
  TouchLinkStats link;
  EXPECT_EQ(touch_rate_hz(link), 0);
  link.answers = 1000;
  link.distinct = 10;
  link.first_answer_s = 7;
  link.last_answer_s = 8;
  EXPECT_EQ(touch_rate_hz(link), 10);
}

}  // namespace
}  // namespace teletact::client
