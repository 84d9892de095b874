// Whose turn it is, on a clock of the test's.
#include "service/touch_plane/touch_queue.h"

#include <gtest/gtest.h>

#include <map>
#include <string>
#include <utility>
#include <vector>

namespace teletact::service {
namespace {

using namespace std::chrono_literals;
using Id = TouchQueue::Id;
using Time = TouchQueue::Time;

class Turns : public testing::Test {
 protected:
  Id join(const char* principal, TouchQueue::Clock::duration period = 2ms, double weight = 1) {
    return queue.join({principal, weight}, period);
  }
  // Whose turn it is; it takes so long. 0: nobody's.
  Id turn(TouchQueue::Clock::duration takes = 0us, bool wants_more = false,
          TouchQueue::Clock::duration own = TouchQueue::Clock::duration::max()) {
    const auto turn = queue.begin(at);
    if (!turn) return 0;
    at += takes;
    queue.done(turn->id, at, wants_more ? at : Time::max(), true, own);
    return turn->id;
  }
  // By one worker, all of these always wanting more: the share of time of each.
  std::map<Id, double> shares(const std::vector<Id>& ids, TouchQueue::Clock::duration takes, int turns) {
    std::map<Id, double> shares;
    for (const Id id : ids) queue.wake(id, at, at);
    for (int k = 0; k < turns; ++k) shares[turn(takes, true)] += 1.0 / turns;
    return shares;
  }
  Time at{1h};
  TouchQueue queue{{2, 20}, at};
};

TEST_F(Turns, EarliestDeadlineFirstAndNoneBeforeItIsDue) {
  const Id slow = join("a", 10ms), fast = join("b", 2ms);
  queue.wake(slow, at, at), queue.wake(fast, at + 1ms, at);
  EXPECT_EQ(queue.next_due(), at + 1ms);
  at += 1ms;
  EXPECT_EQ(turn(), fast);
  EXPECT_EQ(turn(), slow);
  EXPECT_EQ(turn(), 0U);
  queue.wake(slow, at + 5ms, at), queue.wake(slow, at + 1ms, at), queue.wake(slow, at + 3ms, at);
  EXPECT_EQ(queue.next_due(), at + 1ms) << "the earliest that was asked for";
  EXPECT_EQ(turn(), 0U);
}

TEST_F(Turns, AStreamHasOneWorkerAndIsNotForgottenMeanwhile) {
  const Id one = join("a");
  queue.wake(one, at, at);
  ASSERT_TRUE(queue.begin(at));
  queue.wake(one, at, at);
  EXPECT_FALSE(queue.begin(at));
  queue.done(one, at, Time::max(), false);
  EXPECT_EQ(turn(), one);
  EXPECT_EQ(turn(), 0U);
}

TEST_F(Turns, WhoHasManyStreamsHasNoMoreOfTheWorkers) {
  std::vector<Id> all{join("alone")};
  for (int k = 0; k < 99; ++k) all.push_back(join("greedy"));
  EXPECT_NEAR(shares(all, 50us, 20000)[all[0]], 0.5, 0.01);
}

TEST_F(Turns, APrincipalHasItsWeight) {
  const std::vector<Id> all{join("steers"), join("observes", 2ms, 0.25)};
  EXPECT_NEAR(shares(all, 50us, 20000)[all[1]], 0.2, 0.01);
}

TEST_F(Turns, NobodySavesUp) {
  const std::vector<Id> greedy{join("greedy"), join("greedy")};
  shares(greedy, 50us, 20000);
  const Id comes_late = join("late");
  queue.wake(comes_late, at, at);
  std::map<Id, int> turns;
  for (int k = 0; k < 1000; ++k) ++turns[turn(50us, true)];
  EXPECT_NEAR(turns[comes_late], 500, 1000 * TouchQueue::kSliceS / 0.05 + 2);
}

TEST_F(Turns, LongOnesLeaveAWorkerToShortOnes) {
  std::vector<Id> slow;
  for (const char* principal : {"a", "b", "c"}) slow.push_back(join(principal));
  const Id quick = join("quick");
  const auto known = [&](Id id, TouchQueue::Clock::duration takes) {
    queue.wake(id, at, at);
    EXPECT_EQ(turn(takes), id);
  };
  for (const Id id : slow) known(id, 30ms), known(id, 30ms);
  known(quick, 20us);
  for (const Id id : slow) queue.wake(id, at, at);
  EXPECT_TRUE(queue.begin(at));
  EXPECT_FALSE(queue.begin(at)) << "the other worker is not for long ones";
  queue.wake(quick, at, at);
  EXPECT_EQ(turn(20us), quick);
  // One that was held up once is no long one, nor is one that was slow itself.
  queue.wake(quick, at, at);
  EXPECT_EQ(turn(30ms, false, 20us), quick);
  known(quick, 15ms);
  queue.wake(quick, at, at);
  EXPECT_EQ(turn(20us), quick);
}

// On a machine with much other work.
TEST_F(Turns, WhatOtherWorkTookMakesNoTurnLong) {
  const Id slow = join("slow"), held_up = join("held up");
  for (int k = 0; k < 10; ++k)
    for (const Id id : {slow, held_up}) {
      queue.wake(id, at, at);
      ASSERT_EQ(queue.begin(at)->id, id);
      at += 30ms;
      queue.done(id, at, Time::max(), true, id == slow ? 30ms : 50us);
    }
  queue.wake(slow, at, at);
  ASSERT_TRUE(queue.begin(at));
  queue.wake(held_up, at, at);
  EXPECT_TRUE(queue.begin(at)) << "the worker that long ones leave";
}

// Streams that want answers by a clock each, and more of them than the workers can give.
class Overload : public Turns {
 protected:
  using Duration = TouchQueue::Clock::duration;
  struct Asks {
    Duration period;
    Time next;
    int answers = 0;
    std::optional<Duration> takes{};  // in place of what run() says, by one turn in `each`
    int each = 1, turns = 0;
  };
  std::vector<Id> add(const char* principal, int streams, Duration period, std::optional<Duration> takes = {},
                      int each = 1) {
    std::vector<Id> added;
    for (int k = 0; k < streams; ++k) {
      const Id id = added.emplace_back(join(principal, period));
      asks[id] = {period, at, 0, takes, each};
      queue.wake(id, at, at);
    }
    return added;
  }
  void run(Duration length, Duration takes, std::size_t workers = 1) {
    for (auto& [id, ask] : asks) ask.answers = 0;
    const Time until = at + length;
    std::multimap<Time, TouchQueue::Turn> running;
    while (at < until || !running.empty()) {
      while (at < until && running.size() < workers) {
        const auto turn = queue.begin(at);
        if (!turn) break;
        Asks& ask = asks.at(turn->id);
        running.emplace(at + (++ask.turns % ask.each == 0 ? ask.takes.value_or(takes) : takes), *turn);
      }
      const Time due = running.size() < workers ? std::min(queue.next_due(), until) : Time::max();
      if (running.empty() || due < running.begin()->first) {
        at = std::max(at, due);
        if (running.empty() || at < until) continue;
      }
      const auto [over, turn] = *running.begin();
      running.erase(running.begin());
      at = std::max(at, over);
      Asks& ask = asks.at(turn.id);
      ++ask.answers;
      ask.next = std::max(ask.next, at - turn.period) + turn.period;
      queue.done(turn.id, at, ask.next, true);
    }
  }
  void expect_refused(const char* principal, TouchQueue::TurnKind kind = TouchQueue::kShortTurns) {
    EXPECT_TRUE(queue.overload({principal}, kind, at)) << principal;
  }
  void expect_room(const char* principal, TouchQueue::TurnKind kind = TouchQueue::kShortTurns) {
    const auto load = queue.overload({principal}, kind, at);
    EXPECT_FALSE(load) << principal << ": " << *load;
  }
  std::map<Id, Asks> asks;
};

TEST_F(Overload, LengthensThePeriodsOfTheGreediest) {
  add("operator", 1, 2ms);
  add("greedy", 99, 1ms);
  run(5s, 100us);
  const auto [operators, operator_asks] = *asks.begin();
  EXPECT_EQ(queue.period(operators), 2ms) << "asks for less than its share";
  run(5s, 100us);
  int all = 0;
  for (const auto& [id, ask] : asks) {
    all += ask.answers;
    if (id != operators) {
      EXPECT_NEAR(ask.answers, 5 * 96, 40) << "all alike";
    }
  }
  EXPECT_EQ(asks.begin()->second.answers, 2500);
  EXPECT_GT(all, 0.9 * 50000) << "and the worker is not idle";
  EXPECT_GT(std::chrono::duration<double>(queue.period(asks.rbegin()->first)).count(), 0.008);
}

TEST_F(Overload, EndsWhenItIsOver) {
  add("greedy", 100, 1ms);
  run(3s, 100us);
  EXPECT_GT(queue.period(asks.begin()->first), 8ms);
  run(10s, 5us);
  EXPECT_EQ(queue.period(asks.begin()->first), 1ms);
}

TEST_F(Overload, OneMoreIsRefusedOnlyOncePeriodsAreAsLongAsTheyMayBe) {
  add("a", 100, 1ms);
  run(3s, 100us);
  expect_room("b");  // half of 10 000 answers a second
  expect_room("a");
  add("a", 500, 1ms);
  run(10s, 100us);
  const auto load = queue.overload({"a"}, TouchQueue::kShortTurns, at);
  ASSERT_TRUE(load) << "16 a second";
  EXPECT_NE(load->find("600 touch streams"), std::string::npos) << *load;
  EXPECT_EQ(queue.period(asks.begin()->first), 50ms) << "who was admitted is served";
  expect_room("b");  // has a share of its own
  for (const auto& [id, ask] : asks) queue.leave(id);
  run(1s, 100us);
  expect_room("a");
}

TEST_F(Overload, WhoCannotBeSlowedDownAnyFurtherSlowsNobodyElse) {
  add("greedy", 600, 1ms);
  const Id operators = add("operator", 1, 2ms).front();
  run(60s, 100us);
  EXPECT_EQ(queue.period(operators), 2ms);
  expect_room("newcomer");
  run(1s, 100us);
  EXPECT_EQ(asks.at(operators).answers, 500);
}

TEST_F(Overload, IsOverOnceThoseThatMadeItHaveLeft) {
  std::vector<std::string> names;
  for (int k = 0; k < 600; ++k) add(names.emplace_back(std::to_string(k)).c_str(), 1, 1ms);
  run(10s, 100us);
  expect_refused("newcomer");
  join("one that sends nothing");
  for (const auto& [id, ask] : asks) queue.leave(id);
  for (int windows = 0; windows < 2; ++windows) {  // and nobody takes a turn
    at += TouchLoad::kWindow;
    queue.overload({"newcomer"}, TouchQueue::kShortTurns, at);
  }
  expect_room("newcomer");
}

// Streams that come together and are not answered yet, as while a scene's first model is made.
TEST_F(Overload, IsNotSeenInTurnsThatAnswerNothing) {
  std::vector<Id> fresh;
  for (int k = 0; k < 100; ++k) queue.wake(fresh.emplace_back(join("fresh", 2ms)), at, at);
  for (int turns = 0; turns < 100; ++turns) {
    const auto turn = queue.begin(at);
    ASSERT_TRUE(turn);
    at += 10ms;
    queue.done(turn->id, at, Time::max(), false);
  }
  for (const auto kind : {TouchQueue::kShortTurns, TouchQueue::kLongTurns}) expect_room("newcomer", kind);
  for (const Id id : fresh) EXPECT_EQ(queue.period(id), 2ms);
}

TEST_F(Overload, OfLongTurnsIsSeenAndSlowsNoShortOnes) {
  const Id quick = add("quick", 1, 2ms, 20us).front();
  std::vector<Id> slow;
  for (const char* principal : {"a", "b", "c", "d", "e", "f", "g", "h", "i", "j"})
    slow.push_back(add(principal, 1, 2ms, 30ms).front());
  run(20s, 0us, 2);
  EXPECT_EQ(queue.period(quick), 2ms);
  EXPECT_NEAR(asks.at(quick).answers, 10000, 100);
  for (const Id id : slow) EXPECT_EQ(queue.period(id), 50ms);
  expect_refused("another", TouchQueue::kLongTurns);
  expect_refused("a");  // its turns are long
  expect_room("another");
}

// Whatever the share of long turns: who hides them among short ones takes no worker from others.
TEST_F(Overload, OfTurnsThatAreLongNowAndThenSlowsNobodyElse) {
  for (const int each : {1, 2, 4, 9, 30, 100}) {
    for (const auto& [id, ask] : std::exchange(asks, {})) queue.leave(id);
    std::vector<Id> others;
    for (const char* principal : {"a", "b", "c", "d"}) others.push_back(add(principal, 1, 10ms).front());
    add("greedy", 8, 5ms, 200ms, each);
    run(2s, 50us, 2);
    run(5s, 50us, 2);
    for (const Id id : others) {
      EXPECT_GE(asks.at(id).answers, 495) << "one turn in " << each;
      EXPECT_EQ(queue.period(id), 10ms) << each;
    }
  }
}

TEST_F(Overload, LongTurnsOfWhoHasManyShortOnesAreNotForgotten) {
  join("observes", 1ms, 0.25);
  add("observes", 30, 1ms, 50us);  // more than one worker can do
  const Id own = add("observes", 1, 2ms, 5ms).front();
  add("steers", 8, 2ms, 5ms);
  run(2s, 0us, 2);
  run(5s, 0us, 2);
  EXPECT_GE(asks.at(own).answers, 50);
}

TEST_F(Overload, WhoWasHeldUpIsTrustedAgain) {
  const Id one = add("held up", 1, 2ms).front();
  run(100ms, 50us, 2);
  run(30ms, 30ms, 2);
  run(TouchQueue::kDistrusted, 50us, 2);
  add("long", 1, 2ms, 30ms);
  run(5s, 50us, 2);
  EXPECT_NEAR(asks.at(one).answers, 2500, 100) << "waits for no long one";
}

}  // namespace
}  // namespace teletact::service
