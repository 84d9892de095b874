// What is decided of one stream, on a clock of the test's.
#include "service/touch_plane/touch_exchange.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "service/base/choices.h"
#include "service/scene/errors.h"

namespace teletact::service {
namespace {

using namespace std::chrono_literals;
using Work = TouchExchange::Work;
using Time = TouchExchange::Time;

class Exchange : public testing::Test {
 protected:
  static TouchExchange::Terms terms(bool laws = false) { return {2, 2ms, laws, 10, 60}; }
  // Opened, and told so.
  explicit Exchange(bool laws = false) : exchange(terms(laws), at) {
    EXPECT_EQ(exchange.begin(at), Work::kOpen);
    exchange.opened();
    EXPECT_EQ(exchange.begin(at), Work::kNothing) << "a write is under way";
    exchange.written();
  }
  bool pose(std::uint64_t sequence, std::uint64_t acknowledged) {
    return exchange.pose({sequence, acknowledged, {}, {}}, at);
  }
  std::uint64_t answer() {
    EXPECT_EQ(exchange.begin(at), Work::kAnswer);
    const std::uint64_t number = exchange.answered(at, false);
    exchange.written();
    return number;
  }
  Time at{1h};
  TouchExchange exchange;
};

TEST_F(Exchange, NothingIsDueWithoutAPose) {
  EXPECT_EQ(exchange.next(at).due, Time::max());
  EXPECT_EQ(exchange.begin(at), Work::kNothing);
}

TEST_F(Exchange, TheNewestPoseIsAnsweredAPeriodAfterTheLast) {
  EXPECT_FALSE(pose(1, 0));
  EXPECT_EQ(answer(), 1U);
  at += 500us;
  EXPECT_FALSE(pose(2, 1));
  EXPECT_TRUE(pose(3, 1));
  EXPECT_EQ(exchange.next(at).due, at + 1500us);
  EXPECT_EQ(exchange.begin(at), Work::kNothing);
  at += 1500us;
  EXPECT_EQ(exchange.begin(at), Work::kAnswer);
  EXPECT_EQ(exchange.asked().pose.sequence, 3U);
  EXPECT_EQ(exchange.begin(at), Work::kNothing) << "it is being worked on";
  EXPECT_FALSE(pose(4, 1)) << "3 was taken";
  EXPECT_EQ(exchange.answered(at, false), 2U);
}

TEST_F(Exchange, NoMoreAnswersThanTheCreditAreUnacknowledged) {
  pose(1, 0), answer();
  at += 2ms, pose(2, 0), answer();
  at += 2ms, pose(3, 0);
  EXPECT_EQ(exchange.next(at).due, Time::max());
  at += 2ms, pose(4, 1);
  EXPECT_EQ(exchange.next(at).due, at) << "not before it had room";
  EXPECT_EQ(answer(), 3U);
}

TEST_F(Exchange, ALatePoseIsCaughtUpWithOverOnePeriod) {
  pose(1, 0), answer();
  at += 3ms;  // its answer was due 1 ms ago
  pose(2, 1), answer();
  pose(3, 2);
  EXPECT_EQ(exchange.next(at).due, at + 1ms);
}

TEST_F(Exchange, ALongerPeriodIsKeptAndNoShorterOneThanAgreed) {
  exchange.keep(10ms);
  EXPECT_EQ(exchange.period(), 10ms);
  pose(1, 0), answer();
  pose(2, 1);
  EXPECT_EQ(exchange.next(at).due, at + 10ms);
  exchange.keep(1ms);
  EXPECT_EQ(exchange.period(), 2ms);
}

TEST_F(Exchange, RefusesWhatIsOutOfOrder) {
  pose(2, 0);
  EXPECT_THROW(pose(2, 0), std::invalid_argument);
  EXPECT_THROW(pose(3, 1), std::invalid_argument) << "nothing was answered";
  answer();
  pose(3, 1);
  EXPECT_THROW(pose(4, 0), std::invalid_argument) << "it was acknowledged";
  EXPECT_EQ(exchange.counts().poses, 2U);
}

TEST_F(Exchange, WhoSendsPosesAcknowledgesOrEnds) {
  pose(1, 0), answer();
  at += 10s;
  EXPECT_NO_THROW(pose(2, 0));
  at += 1ns;
  EXPECT_THROW(pose(3, 0), Error);
  EXPECT_NO_THROW(pose(3, 1));
}

TEST_F(Exchange, SilenceEndsAStream) {
  at += 60s;
  EXPECT_NO_THROW(exchange.require_poses(at));
  EXPECT_THROW(exchange.require_poses(at + 1ns), Error);
}

TEST_F(Exchange, LeavesOnceWhateverIsUnderWay) {
  pose(1, 0);
  EXPECT_EQ(exchange.begin(at), Work::kAnswer);
  exchange.end();
  EXPECT_EQ(exchange.next(at).due, Time::max()) << "one thing at a time";
  exchange.answered(at, false);
  EXPECT_EQ(exchange.begin(at), Work::kLeave) << "nobody waits for the write";
  exchange.end(), exchange.written();
  EXPECT_EQ(exchange.next(at).due, Time::max());
  EXPECT_EQ(exchange.begin(at), Work::kLeave) << "who did not see it is told again";
}

class ExchangeWithLaws : public Exchange {
 protected:
  ExchangeWithLaws() : Exchange(true) {}
  void told() {
    exchange.law_sent(at, true, true);
    EXPECT_EQ(exchange.begin(at), Work::kNothing) << "it is being written";
    exchange.written();
  }
  std::uint64_t answer_after_none(bool more) {
    EXPECT_EQ(exchange.begin(at), Work::kLawBefore);
    exchange.law_sent(at, false, more);
    EXPECT_EQ(exchange.begin(at), Work::kAnswer);
    const std::uint64_t number = exchange.answered(at, more);
    exchange.written();
    return number;
  }
};

TEST_F(ExchangeWithLaws, TheFirstAnswerWaitsForALawLaterOnesDoNot) {
  pose(1, 0);
  const Time until = at + choices::kLawStep;
  for (; at < until; at += TouchExchange::kLookForLaw) {
    ASSERT_EQ(exchange.begin(at), Work::kLawBefore);
    exchange.law_sent(at, false, false);
    ASSERT_EQ(exchange.next(at).due, at + TouchExchange::kLookForLaw);
  }
  EXPECT_EQ(answer_after_none(false), 1U);
  at += 2ms, pose(2, 1);
  EXPECT_EQ(answer_after_none(false), 2U);
}

TEST_F(ExchangeWithLaws, PiecesNearTheFingerGoBeforeItsAnswer) {
  pose(1, 0);
  for (int piece = 0; piece < 5; ++piece) {
    ASSERT_EQ(exchange.begin(at), Work::kLawBefore);
    told();
  }
  pose(2, 0);
  at += choices::kLawStep;
  EXPECT_EQ(answer_after_none(false), 1U);
  EXPECT_EQ(exchange.finger()->sequence, 1U) << "the one that was taken";
}

TEST_F(ExchangeWithLaws, TwoPiecesAtMostGoBetweenAnswers) {
  at += choices::kLawStep, pose(1, 0), at += choices::kLawStep;
  answer_after_none(true);
  at += 2ms, pose(2, 1);
  for (int piece = 0; piece < 2; ++piece) {
    ASSERT_EQ(exchange.begin(at), Work::kLaw);
    told();
  }
  EXPECT_EQ(answer_after_none(true), 2U);
  EXPECT_EQ(exchange.begin(at), Work::kLaw) << "again after an answer";
  exchange.law_sent(at, false, true);
  EXPECT_EQ(exchange.next(at).due, at + choices::kLawStep) << "looked for again soon";
  at += choices::kLawStep;
  EXPECT_EQ(exchange.begin(at), Work::kLaw);
  exchange.law_sent(at, false, false);
  EXPECT_EQ(exchange.next(at).due, Time::max()) << "all is told";
}

}  // namespace
}  // namespace teletact::service
