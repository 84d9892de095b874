// A service that is about to stop, and its successor at the same address.
#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "client/link/recording.h"
#include "client/link/servo_messages.h"
#include "tests/link/operator.h"

namespace teletact::client {
namespace {

using test::answers_at_least;
using test::FakePalpation;
using test::Operator;

// A service that serves, and another that the same address leads to as soon as it serves.
struct Moving : testing::Test {
  Moving() { before.serve(); }
  std::string address = test::socket_address("moving");
  FakePalpation before{address}, after{address};
};

// Of an answer, s: a near service, and one far away.
struct MovingOver : Moving, testing::WithParamInterface<double> {};
INSTANTIATE_TEST_SUITE_P(Ways, MovingOver, testing::Values(0.0, 1.2 * TouchLink::kHeartbeatS));

// Answers as they came to the servo: none is missing, none comes twice, none is older than the one before
// but, of two services' that cross, the successor's first, which the servo passes over.
TEST_P(MovingOver, TheSuccessorIsOpenedFirstAndAnswersNeverStop) {
  for (FakePalpation* service : {&before, &after}) service->way_s = GetParam();
  const std::uint64_t enough = GetParam() > 0 ? 5 : 50;  // far away one comes after the other
  Operator person(address);
  ASSERT_TRUE(before.wait_until(answers_at_least(enough)));
  after.serve();
  before.moving = true;
  std::uint64_t newest = 0, crossed = 0;
  double longest_s = 0, last_s = 1e-9 * double(person.clock.now_ns());
  ASSERT_TRUE(test::within(10, [&] {
    for (ServoAnswer answer; person.answers.take(answer);) {
      EXPECT_NE(answer.sample.sequence, newest);
      EXPECT_TRUE(answer.has_force);
      if (answer.sample.sequence < newest) {
        ++crossed;
        continue;
      }
      newest = answer.sample.sequence;
      const double received_s = 1e-9 * double(answer.received_ns);
      longest_s = std::max(longest_s, received_s - last_s);
      last_s = received_s;
    }
    return after.account().answers > 2 * enough;
  }));
  std::printf("longest time without an answer %.1f ms\n", 1e3 * longest_s);
  EXPECT_LE(crossed, 1u);
  EXPECT_EQ(after.account().session, before.account().session);
  EXPECT_EQ(after.account().streams, 1u);
  EXPECT_EQ(after.account().disorder + after.account().wrong_acknowledgements, 0u);
  EXPECT_EQ(person.link->stats().streams, 2u);
  EXPECT_EQ(person.link->stats().dropped, 0u);
  EXPECT_EQ(person.link->trouble(), "");
  // The old stream was ended.
  const auto poses = before.account().poses;
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  EXPECT_LE(before.account().poses, poses + 2);  // that were on their way
}

TEST_F(Moving, UntilASuccessorAnswersTheOldStreamIsFelt) {
  Operator person(address);
  ASSERT_TRUE(before.wait_until(answers_at_least(50)));
  after.full = true;
  after.serve();
  before.moving = true;
  ASSERT_TRUE(after.wait_until([](const auto& account) { return account.refused >= 3; }));
  const auto answers = before.account().answers;
  ASSERT_TRUE(before.wait_until(answers_at_least(answers + 50)));
  after.prepares = true;  // it is opened, but says nothing that can be felt
  after.full = false;
  ASSERT_TRUE(after.wait_until(answers_at_least(20)));
  const auto more = before.account().answers;
  ASSERT_TRUE(before.wait_until(answers_at_least(more + 50)));
  EXPECT_EQ(person.link->stats().streams, 1u);
  EXPECT_EQ(person.link->stats().preparing, 0u);
  after.prepares = false;
  ASSERT_TRUE(test::within(10, [&] { return person.link->stats().streams == 2; }));
}

void yields_for_a_while(TouchLinkOptions& options) {
  options.yield_s = 0.4;
}

// Whoever comes first steers over there: the one that steers here.
TEST_F(Moving, WhoDoesNotSteerLetsWhoDoesGoFirst) {
  before.another_steers = true;
  Operator person(address, yields_for_a_while);
  ASSERT_TRUE(before.wait_until(answers_at_least(50)));
  after.serve();
  const auto told = std::chrono::steady_clock::now();
  before.moving = true;
  ASSERT_TRUE(after.wait_until(answers_at_least(20)));
  EXPECT_GE(test::seconds_since(told), 0.4);
  EXPECT_EQ(person.link->trouble(), "");
}

// So it is, too, where the other service takes longer to serve than that.
TEST_F(Moving, WhoDoesNotSteerLetsWhoDoesGoFirstWheneverThatCan) {
  before.another_steers = true;
  Operator person(address, yields_for_a_while);
  ASSERT_TRUE(before.wait_until(answers_at_least(50)));
  after.full = after.steers = true;
  after.serve();
  before.moving = true;
  ASSERT_TRUE(after.wait_until([](const auto& account) { return account.refused >= 2; }));
  const auto serves = std::chrono::steady_clock::now();
  after.full = false;
  ASSERT_TRUE(after.wait_until(answers_at_least(20)));
  EXPECT_GE(test::seconds_since(serves), 0.4);
  EXPECT_EQ(person.link->stats().streams, 2u);
  EXPECT_EQ(person.link->trouble(), "");
}

// ... and where that one answers before the stream there has been ended.
TEST_F(Moving, WhoGoesLaterDoesNotTakeAnAnswerThatIsThereAlready) {
  before.another_steers = true;
  Operator person(address, yields_for_a_while);
  ASSERT_TRUE(before.wait_until(answers_at_least(50)));
  after.steers = true;
  after.answers_unasked = before.last_pose();
  after.serve();
  const auto serves = std::chrono::steady_clock::now();
  before.moving = true;
  ASSERT_TRUE(test::within(10, [&] { return person.link->stats().streams == 2; }));
  EXPECT_GE(test::seconds_since(serves), 0.8) << "at first, and where it was the first there all the same";
}

// Killed amid the move: the stream that is open takes its place; where there is none, another is opened.
TEST_F(Moving, KilledServiceIsFollowedByItsSuccessor) {
  Operator person(address);
  ASSERT_TRUE(before.wait_until(answers_at_least(50)));
  after.prepares = true;
  after.serve();
  before.moving = true;
  ASSERT_TRUE(after.wait_until(answers_at_least(5)));
  before.kill();
  ASSERT_TRUE(test::within(10, [&] { return person.link->stats().preparing > 10; }));
  EXPECT_EQ(after.account().streams, 1u);
  after.prepares = false;
  const auto answers = after.account().answers;
  ASSERT_TRUE(after.wait_until(answers_at_least(answers + 50)));
  EXPECT_EQ(person.link->trouble(), "");
}

// Services that say so without end are moved between ever more seldom.
TEST_F(Moving, WhoeverMovesAgainAndAgainIsNotFollowedAsOften) {
  before.moving = true;
  const auto begin = std::chrono::steady_clock::now();
  Operator person(address);
  ASSERT_TRUE(test::within(20, [&] { return person.link->stats().streams >= 5; }));
  EXPECT_GE(test::seconds_since(begin), 0.7) << "at once, after 0.1, 0.2 and 0.4 s";
  const auto answers = before.account().answers;
  EXPECT_TRUE(before.wait_until(answers_at_least(answers + 50)));
}

// One stream after the other, each whole, as replays read them.
TEST_F(Moving, ARecordingHasOneStreamAfterTheOther) {
  const std::string path = testing::TempDir() + "moving.record";
  {
    RecordWriter recorder(path, {});
    Operator person(address, [&](TouchLinkOptions& options) { options.recorder = &recorder; });
    ASSERT_TRUE(before.wait_until(answers_at_least(20)));
    after.serve();
    before.moving = true;
    ASSERT_TRUE(after.wait_until(answers_at_least(20)));
    person.link->stop();
    recorder.close();
  }
  RecordReader reader(path);
  std::vector<std::uint32_t> opens;
  std::uint32_t call = 0;
  std::uint64_t answers = 0;
  while (const auto entry = reader.next()) {
    EXPECT_GE(entry->call(), call);
    call = entry->call();
    if (entry->has_touch_request() && entry->touch_request().has_open()) opens.push_back(call);
    if (!entry->has_touch_response()) continue;
    if (entry->touch_response().has_opened()) answers = 0;
    if (entry->touch_response().has_answer()) {
      EXPECT_EQ(entry->touch_response().answer().answer(), ++answers);
    }
  }
  EXPECT_EQ(opens, (std::vector<std::uint32_t>{1, 2}));
  EXPECT_GE(answers, 10u);
}

}  // namespace
}  // namespace teletact::client
