// The order of jobs, played through in slices on a clock of its own.
#include "service/scene/schedule.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <utility>

#include "service/scene/errors.h"
#include "tests/scene/error_kind.h"

namespace teletact::service {
namespace {

using Time = Schedule::Time;
constexpr double kStepS = 0.01;

// Works on the queue's jobs one step at a time, as the threads do, and keeps when each was done.
class Plane {
 public:
  Schedule::Id add(const std::string& client, double works_s, double deadline_s = 0, bool owed = false) {
    JobTerms terms;
    terms.client = client;
    terms.cost_s = works_s;
    terms.owed = owed;
    if (deadline_s > 0) terms.deadline = at(deadline_s);
    const auto id = queue.add(terms, at(now_s));
    left_s_[id] = works_s;
    return id;
  }
  void run(double until_s) {
    for (; now_s < until_s - 1e-9; now_s += kStepS) {
      if (before_step) before_step();
      if (running_ && queue.makes_way(running_, at(now_s))) running_ = 0;
      if (!running_) {
        const auto next = queue.next(0, at(now_s));
        if (!next) continue;
        running_ = *next;
        queue.begun(running_);
      }
      queue.served(running_, kStepS, at(now_s + kStepS));
      if ((left_s_[running_] -= kStepS) > 1e-9) continue;
      done_s[running_] = now_s + kStepS;
      queue.ended(std::exchange(running_, 0), at(now_s + kStepS));
    }
  }
  // False: it waits until another has given it back.
  bool take(Schedule::Id id, const void* scene) {
    const bool taken = queue.take(id, scene);
    if (!taken && running_ == id) running_ = 0;
    return taken;
  }
  static Time at(double s) { return Time() + std::chrono::microseconds(std::llround(1e6 * s)); }

  Schedule queue;
  double now_s = 1000;
  std::map<Schedule::Id, double> done_s;
  std::function<void()> before_step;

 private:
  std::map<Schedule::Id, double> left_s_;
  Schedule::Id running_ = 0;
};

TEST(Schedule, OneOfLongCallsDoesNotHoldAnother) {
  Plane plane;
  for (int k = 0; k < 8; ++k) plane.add("greedy", 60);
  plane.run(1010);
  const auto mine = plane.add("fair", 0.5);
  plane.run(1012);
  ASSERT_TRUE(plane.done_s.contains(mine));
  EXPECT_LE(plane.done_s[mine] - 1010, 2 * 0.5 + 2 * Schedule::kSliceS + 1e-9);
}

TEST(Schedule, ClientsGetAsMuchAsEachOtherWhateverTheyPost) {
  Plane plane;
  for (int k = 0; k < 12; ++k) plane.add("many", 3);
  plane.add("one", 100);
  const auto two = plane.add("two", 10);
  plane.run(1029.9);
  EXPECT_FALSE(plane.done_s.contains(two));
  plane.run(1030.5);
  EXPECT_TRUE(plane.done_s.contains(two));  // a third of 30 s
}

TEST(Schedule, NobodySavesUp) {
  Plane plane;
  plane.add("long", 200);
  plane.add("away", 0.1);
  plane.run(1060);  // a minute in which "away" asked for nothing
  plane.add("away", 50);
  const auto third = plane.add("third", 1);
  plane.run(1064);
  EXPECT_TRUE(plane.done_s.contains(third));  // a third each, not after a minute of "away"
}

TEST(Schedule, TurnsOfOneThatNeedsASceneAreThoseOfTheOneThatHasIt) {
  Plane plane;
  const int scene = 0;
  const auto owed = plane.add("fair", 1, 1100, true);
  plane.run(1000.5);
  EXPECT_TRUE(plane.take(owed, &scene));
  const auto greedy = plane.add("greedy", 60), waits = plane.add("fair", 1);
  plane.run(1001.5);
  EXPECT_FALSE(plane.take(waits, &scene));
  plane.run(1002.7);
  ASSERT_TRUE(plane.done_s.contains(owed));  // 0.5 s were left, and 1.2 s are shared with the greedy one
  EXPECT_FALSE(plane.done_s.contains(waits));
  plane.run(1005);
  EXPECT_TRUE(plane.done_s.contains(waits));
  EXPECT_FALSE(plane.done_s.contains(greedy));
}

JobTerms terms_of(const char* client, std::size_t device = 0) {
  JobTerms terms;
  terms.client = client;
  terms.device = device;
  return terms;
}

TEST(Schedule, DevicesHaveTurnsAndAccountsOfTheirOwn) {
  Schedule schedule;
  const Time now = Plane::at(1000);
  const auto first = schedule.add(terms_of("a"), now), second = schedule.add(terms_of("a", 1), now),
             other = schedule.add(terms_of("b", 1), now);
  EXPECT_EQ(schedule.next(0, now), first);
  EXPECT_EQ(schedule.next(1, now), second);
  EXPECT_EQ(schedule.next(2, now), std::nullopt);
  for (const auto id : {first, second}) schedule.begun(id);
  schedule.served(first, 5, now);
  EXPECT_FALSE(schedule.makes_way(first, now)) << "for a job of the other device";
  EXPECT_EQ(schedule.next(1, now), second) << "nor is it charged there";
  schedule.served(second, 5, now);
  EXPECT_TRUE(schedule.makes_way(second, now));
  EXPECT_EQ(schedule.next(1, now), other);
  JobTerms terms = terms_of("c");
  terms.cost_s = 1;
  EXPECT_DOUBLE_EQ(schedule.done_in_s(terms, now), 2);
  terms.device = 1;
  EXPECT_DOUBLE_EQ(schedule.done_in_s(terms, now), 3);
}

TEST(Schedule, ADeviceGoesOnWhileOneOfItsJobsNeedsWhatAnothersHas) {
  Schedule schedule;
  const Time now = Plane::at(1000);
  const int scene = 0;
  JobTerms owed = terms_of("a", 1);
  owed.owed = true;
  const auto has = schedule.add(terms_of("a"), now), needs = schedule.add(owed, now),
             next = schedule.add(owed, now);
  for (const auto id : {has, needs}) schedule.begun(id);
  EXPECT_TRUE(schedule.take(has, &scene));
  EXPECT_FALSE(schedule.take(needs, &scene));
  EXPECT_TRUE(schedule.waits_elsewhere(needs));
  EXPECT_EQ(schedule.next(1, now), next);
  schedule.ended(has, now);
  EXPECT_FALSE(schedule.waits_elsewhere(needs));
  EXPECT_EQ(schedule.next(1, now), needs);
  EXPECT_TRUE(schedule.take(needs, &scene));
}

TEST(Schedule, BackgroundClientsTakeTurns) {
  Schedule schedule;
  const Time now = Plane::at(1000);
  const auto add = [&](const char* client) {
    JobTerms terms = terms_of(client);
    terms.background = true;
    return schedule.add(terms, now);
  };
  std::vector<Schedule::Id> all;
  for (std::size_t k = 0; k < 2 * Schedule::kMaxWaiting; ++k) all.push_back(add("a"));  // no bound of ours
  const auto first_of_b = add("b"), second_of_b = add("b");
  std::vector<Schedule::Id> done;
  for (int k = 0; k < 5; ++k) {
    const auto id = schedule.next(0, now).value();
    done.push_back(id);
    schedule.begun(id);
    EXPECT_FALSE(schedule.makes_way(id, now));
    schedule.served(id, k == 0 ? 60 : 0.001, now);
    schedule.ended(id, now);
  }
  EXPECT_EQ(done, (std::vector<Schedule::Id>{all[0], first_of_b, all[1], second_of_b, all[2]}));
}

TEST(Schedule, TakesTheEarliestDeadlineOfAClientFirst) {
  Plane plane;
  const auto begun = plane.add("a", 1);
  plane.run(1000.5);
  const auto whenever = plane.add("a", 1), late = plane.add("a", 1, 1100), soon = plane.add("a", 1, 1005);
  plane.run(1010);
  EXPECT_LT(plane.done_s[begun], plane.done_s[soon]);
  EXPECT_LT(plane.done_s[soon], plane.done_s[late]);
  EXPECT_LT(plane.done_s[late], plane.done_s[whenever]);
}

TEST(Schedule, WhatIsOwedWaitsForAllUntilItIsDueAndThenForNobody) {
  Plane plane;
  for (int k = 0; k < 8; ++k) plane.add("greedy", 60);
  plane.run(1001);
  const auto first = plane.add("fair", 0.2, 1002, true), second = plane.add("fair", 0.2, 1002, true);
  plane.run(1003);
  for (const auto id : {first, second}) {
    ASSERT_TRUE(plane.done_s.contains(id));
    EXPECT_GT(plane.done_s[id], 1001.5);      // no sooner than it must
    EXPECT_LE(plane.done_s[id], 1002 + 0.2);  // the second after the first
  }
  Plane idle;
  const auto owed = idle.add("fair", 0.2, 1100, true);
  idle.run(1000.3);
  EXPECT_TRUE(idle.done_s.contains(owed));  // at once, where nobody asks for anything
}

TEST(Schedule, WhatIsOwedIsDoneInTimeUnderAnOverloadOfPublications) {
  Plane plane;
  double next_s = 1000;
  std::vector<std::pair<Schedule::Id, double>> owed;
  plane.before_step = [&] {
    if (plane.now_s < next_s) return;
    next_s += 0.5;
    owed.emplace_back(plane.add("publisher", 0.1, plane.now_s + 1, true), plane.now_s + 1);
    for (const char* client : {"a", "b", "c"}) try {
        plane.add(client, 1);
      } catch (const Error&) {  // its queue is full
      }
  };
  plane.run(1030);
  for (const auto& [id, deadline_s] : owed) {
    if (deadline_s > 1029) continue;
    ASSERT_TRUE(plane.done_s.contains(id)) << deadline_s;
    EXPECT_LE(plane.done_s[id], deadline_s + Schedule::kSliceS + 1e-6);
  }
}

TEST(Schedule, WhatIsOwedIsChargedToItsClient) {
  Plane plane;
  plane.add("publisher", 100);
  plane.add("other", 100);
  const auto owed = plane.add("publisher", 2, 1001, true);
  plane.run(1001);
  const auto later = plane.add("third", 0.01);
  plane.run(1006);
  EXPECT_TRUE(plane.done_s.contains(owed));
  EXPECT_TRUE(plane.done_s.contains(later));
  const auto next = plane.queue.next(0, Plane::at(1003));
  ASSERT_TRUE(next.has_value());
}

TEST(Schedule, BoundedForEachClientAndInAll) {
  Plane plane;
  for (std::size_t k = 0; k < Schedule::kMaxWaitingPerClient; ++k) plane.add("greedy", 60);
  EXPECT_EQ(kind_of([&] { plane.add("greedy", 60); }), ErrorKind::kExhausted);
  EXPECT_NO_THROW(plane.add("fair", 1));  // its place is its own
  std::size_t all = Schedule::kMaxWaitingPerClient + 1;
  for (int client = 0; all < Schedule::kMaxWaiting; ++all, ++client)
    plane.add("client " + std::to_string(client), 1);
  EXPECT_EQ(kind_of([&] { plane.add("one too many", 1); }), ErrorKind::kExhausted);
  EXPECT_NO_THROW(plane.add("one too many", 1, 1001, true));  // debts are bounded by who owes
}

TEST(Schedule, NoMoreAreBegunThanStatedButWhatIsOwedStillIs) {
  Plane plane;
  std::vector<Schedule::Id> begun;
  for (std::size_t k = 0; k < Schedule::kMaxBegun; ++k) plane.add("client " + std::to_string(k), 100);
  plane.run(1002);  // every one has had its first turn
  const auto waits = plane.add("late", 0.1), owed = plane.add("late", 0.1, 1003, true);
  plane.run(1010);
  EXPECT_FALSE(plane.done_s.contains(waits));
  EXPECT_TRUE(plane.done_s.contains(owed));
}

TEST(Schedule, WhatCannotBeginBeforeItsDeadlineExpires) {
  Plane plane;
  plane.add("a", 10);
  plane.run(1001);
  const auto late = plane.add("a", 1, 1005);
  plane.add("a", 1, 1004, true);
  EXPECT_TRUE(plane.queue.expired(Plane::at(1004.9)).empty());
  EXPECT_EQ(plane.queue.expired(Plane::at(1005)), std::vector<Schedule::Id>{late});
  plane.queue.ended(late, Plane::at(1005));
  EXPECT_TRUE(plane.queue.expired(Plane::at(1006)).empty());
}

TEST(Schedule, TellsWhenAJobCouldBeDone) {
  Plane plane;
  const auto told = [&](const std::string& client, double works_s, double deadline_s = 0) {
    JobTerms terms;
    terms.client = client;
    terms.cost_s = works_s;
    if (deadline_s > 0) terms.deadline = Plane::at(deadline_s);
    return plane.queue.done_in_s(terms, Plane::at(plane.now_s));
  };
  EXPECT_DOUBLE_EQ(told("a", 0.5), 0.5);
  plane.add("a", 2, 1100);
  EXPECT_DOUBLE_EQ(told("a", 0.5), 2.5);  // after it, as without a deadline
  EXPECT_DOUBLE_EQ(told("a", 0.5, 1200), 2.5);
  EXPECT_DOUBLE_EQ(told("a", 0.5, 1050), 0.5);  // before it
  plane.run(1001);                              // it has begun, and is finished first
  EXPECT_NEAR(told("a", 0.5, 1050), 1.5, 1e-6);
  EXPECT_NEAR(told("b", 0.5), 2 * 0.5, 1e-6);  // in turn with "a"
  plane.add("c", 0.1, 1002, true);             // what is owed goes before
  EXPECT_NEAR(told("b", 0.5), 2 * 0.5 + 0.1, 1e-6);
  plane.run(1010);  // all is done, and long ago
  EXPECT_DOUBLE_EQ(told("b", 0.5), 0.5);
}

TEST(Schedule, WhatWasToldIsKept) {
  for (const int others : {0, 1, 3}) {
    Plane plane;
    for (int k = 0; k < others; ++k) plane.add("other " + std::to_string(k), 30);
    plane.run(1001);
    JobTerms terms;
    terms.client = "mine";
    terms.cost_s = 0.4;
    const double told_s = plane.queue.done_in_s(terms, Plane::at(plane.now_s));
    const auto mine = plane.add("mine", 0.4);
    plane.run(1010);
    ASSERT_TRUE(plane.done_s.contains(mine));
    EXPECT_LE(plane.done_s[mine] - 1001, told_s + (others + 1) * Schedule::kSliceS) << others;
    EXPECT_GE(plane.done_s[mine] - 1001, 0.5 * told_s) << others;
  }
}

}  // namespace
}  // namespace teletact::service
