#include "client/session/tick_log.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "client/servo/tick_statistics.h"

namespace teletact::client {
namespace {

// Ticks at 1 kHz into a log; what it said.
class TickLogTest : public ::testing::Test {
 protected:
  void run(int ticks) {
    for (int n = 0; n < ticks; ++n) {
      for (const LogMessage& line : log_.add(tick_))
        said_.push_back((line.warning ? "W " : "I ") + line.text);
      tick_.time_ns += 1'000'000;
    }
  }
  void enable() {
    tick_.state = ServoState::kEnabled;
    tick_.reason = StateReason::kResumed;
    run(10);
    said_.clear();
  }
  TickLog log_;
  ServoTick tick_;
  using Lines = std::vector<std::string>;
  Lines said_;
};

TEST_F(TickLogTest, SaysEveryStateOnceWithItsReason) {
  run(3);
  tick_.state = ServoState::kPaused;
  tick_.reason = StateReason::kSilence;
  run(3);
  ASSERT_EQ(said_.size(), 2u);
  EXPECT_EQ(said_[0], "I servo DISABLED: not started yet");
  EXPECT_EQ(said_[1].rfind("W servo PAUSED: no answer", 0), 0u) << said_[1];
}

TEST_F(TickLogTest, NamesTheLawOnceInFiveSeconds) {
  enable();
  tick_.by_law = true;
  tick_.round_trip_s = 0.1;
  run(100);
  EXPECT_EQ(said_, Lines()) << "above the tissue";
  tick_.force_n.y() = -0.1;
  run(100);
  for (int k = 0; k < 400; ++k) {
    tick_.by_law = !tick_.by_law;
    run(1);
  }
  ASSERT_EQ(said_.size(), 1u);
  EXPECT_EQ(said_[0],
            "I the force is a contact law's: that of where the finger is; the round trip is 100 ms");
  tick_.by_law = false;
  run(1000);
  ASSERT_EQ(said_.size(), 2u);
  EXPECT_EQ(said_[1],
            "I no contact law here: the force is that of the newest answer; the round trip is 100 ms");
  for (int k = 0; k < 12; ++k) {  // over borders, one after the other
    tick_.by_law = !tick_.by_law;
    run(1000);
  }
  EXPECT_GE(said_.size(), 4u);
  EXPECT_LE(said_.size(), 7u) << "each once in 5 s";
}

TEST_F(TickLogTest, SaysBothEdgesOfDegradedAndWhy) {
  enable();
  tick_.degraded = true;
  tick_.sequence = 1;
  tick_.model_age_s = 0.262;
  run(300);
  tick_.degraded = false;
  run(2000);
  tick_.degraded = true;
  tick_.model_age_s = 0.304;
  tick_.round_trip_s = 0.3;
  run(20);
  tick_.degraded = false;
  run(2000);
  tick_.degraded = tick_.energy_generated = true;
  tick_.energy_j = -0.0062;
  run(5);
  EXPECT_EQ(
      said_,
      (Lines{"W servo DEGRADED, force reduced: the answer behind it is 262 ms old",
             "I servo no longer DEGRADED, after 0.30 s",
             "W servo DEGRADED, force reduced: the answer behind it is 304 ms old, the round trip 300 ms",
             "I servo no longer DEGRADED, after 0.02 s",
             "W servo DEGRADED, force fading: the display generated energy, 6.2 mJ in all"}));
}

TEST_F(TickLogTest, BeforeTheFirstAnswerThereIsNoAge) {
  enable();
  tick_.degraded = true;
  tick_.model_age_s = 1e9;
  run(10);
  EXPECT_EQ(said_, (Lines{"W servo DEGRADED, no force: no answer to render yet"}));
  TickStatistics statistics;
  statistics.add(tick_);
  EXPECT_EQ(statistics.model_age_s().count(), 0u);
  tick_.sequence = 1;
  statistics.add(tick_);
  EXPECT_EQ(statistics.model_age_s().count(), 1u);
}

TEST_F(TickLogTest, SaysThatForceIsWithheldAndWhatToDo) {
  enable();
  tick_.degraded = true;
  tick_.withheld = 0.62;
  tick_.withholds = true;
  tick_.refused = {EnergyClaim::kLaw, 0.0032};
  run(10);
  EXPECT_EQ(said_,
            (Lines{"W servo DEGRADED, 62 % of the force withheld: another contact law needs 3.2 mJ more; "
                   "lift the finger and press again"}));
}

TEST_F(TickLogTest, SaysWhenTheServiceDoubtsItsAnswer) {
  enable();
  tick_.service_degraded = true;
  run(100);
  tick_.service_degraded = false;
  run(1);
  EXPECT_EQ(said_, (Lines{"W servo DEGRADED by the service, felt as it is: the service's warning says why",
                          "I servo no longer DEGRADED by the service, after 0.10 s"}));
}

// A jittery link fades ten times a second: two lines a second are enough, and none is uncounted.
TEST_F(TickLogTest, CountsWhatItDoesNotSay) {
  enable();
  for (int n = 0; n < 11; ++n) {
    tick_.faded = true;
    tick_.silence_s = 0.051;
    run(40);
    tick_.faded = false;
    run(60);
  }
  ASSERT_EQ(said_.size(), 4u);
  EXPECT_EQ(said_[0], "W servo fading, no answer for 51 ms");
  EXPECT_EQ(said_[1], "I servo no longer fading, after 0.04 s");
  EXPECT_EQ(said_[2], "W servo fading, no answer for 51 ms; 9 times more since the last such line");
}

TEST_F(TickLogTest, FadingThatEndsInAPauseIsNoRecovery) {
  enable();
  tick_.faded = true;
  tick_.silence_s = 0.34;
  run(150);
  tick_.state = ServoState::kPaused;
  tick_.reason = StateReason::kSilence;
  run(10);
  ASSERT_EQ(said_.size(), 2u);
  EXPECT_EQ(said_[1].rfind("W servo PAUSED: no answer", 0), 0u) << said_[1];
}

TEST_F(TickLogTest, SaysOnceASecondWhyAResumeIsIgnored) {
  run(1);
  said_.clear();
  tick_.resume_refused = "no answer comes from the service";
  run(1500);
  EXPECT_EQ(said_, Lines(2, "W resume ignored: no answer comes from the service"));
}

TEST_F(TickLogTest, SaysNothingOfForceThatIsOff) {
  tick_.degraded = tick_.faded = tick_.service_degraded = true;
  run(10);
  ASSERT_EQ(said_.size(), 1u);  // the state
}

}  // namespace
}  // namespace teletact::client
