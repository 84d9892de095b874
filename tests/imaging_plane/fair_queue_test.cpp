// The imaging plane's order of jobs, played through in slices on a clock of its own.
#include "service/imaging_plane/fair_queue.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <utility>

#include "service/scene/errors.h"
#include "tests/imaging_plane/error_kind.h"

namespace teletact::service {
namespace {

using Time = FairQueue::Time;
constexpr double kStepS = 0.01;

// Works on the queue's jobs one step at a time, as the threads do, and keeps when each was done.
class Plane {
 public:
  FairQueue::Id add(const std::string& client, double works_s, double deadline_s = 0, bool owed = false) {
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
        const auto next = queue.next(at(now_s));
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
  void wait(FairQueue::Id id, FairQueue::Id other) {
    queue.wait(id, other);
    if (running_ == id) running_ = 0;
  }
  static Time at(double s) { return Time() + std::chrono::microseconds(std::llround(1e6 * s)); }

  FairQueue queue;
  double now_s = 1000;
  std::map<FairQueue::Id, double> done_s;
  std::function<void()> before_step;

 private:
  std::map<FairQueue::Id, double> left_s_;
  FairQueue::Id running_ = 0;
};

TEST(FairQueue, OneOfLongCallsDoesNotHoldAnother) {
  Plane plane;
  for (int k = 0; k < 8; ++k) plane.add("greedy", 60);
  plane.run(1010);
  const auto mine = plane.add("fair", 0.5);
  plane.run(1012);
  ASSERT_TRUE(plane.done_s.contains(mine));
  EXPECT_LE(plane.done_s[mine] - 1010, 2 * 0.5 + 2 * FairQueue::kSliceS + 1e-9);
}

TEST(FairQueue, ClientsGetAsMuchAsEachOtherWhateverTheyPost) {
  Plane plane;
  for (int k = 0; k < 12; ++k) plane.add("many", 3);
  plane.add("one", 100);
  const auto two = plane.add("two", 10);
  plane.run(1029.9);
  EXPECT_FALSE(plane.done_s.contains(two));
  plane.run(1030.5);
  EXPECT_TRUE(plane.done_s.contains(two));  // a third of 30 s
}

TEST(FairQueue, NobodySavesUp) {
  Plane plane;
  plane.add("long", 200);
  plane.add("away", 0.1);
  plane.run(1060);  // a minute in which "away" asked for nothing
  plane.add("away", 50);
  const auto third = plane.add("third", 1);
  plane.run(1064);
  EXPECT_TRUE(plane.done_s.contains(third));  // a third each, not after a minute of "away"
}

TEST(FairQueue, TurnsOfOneWhoWaitsAreAnothers) {
  Plane plane;
  const auto owed = plane.add("fair", 1, 1100, true);
  plane.run(1000.5);
  const auto greedy = plane.add("greedy", 60), waits = plane.add("fair", 1);
  plane.run(1001.5);
  plane.wait(waits, owed);
  plane.run(1002.7);
  ASSERT_TRUE(plane.done_s.contains(owed));  // 0.5 s were left, and 1.2 s are shared with the greedy one
  EXPECT_FALSE(plane.done_s.contains(waits));
  plane.run(1005);
  EXPECT_TRUE(plane.done_s.contains(waits));
  EXPECT_FALSE(plane.done_s.contains(greedy));
}

TEST(FairQueue, EarliestDeadlineFirstWithinAClientAndWhatIsBegunIsFinished) {
  Plane plane;
  const auto begun = plane.add("a", 1);
  plane.run(1000.5);
  const auto whenever = plane.add("a", 1), late = plane.add("a", 1, 1100), soon = plane.add("a", 1, 1005);
  plane.run(1010);
  EXPECT_LT(plane.done_s[begun], plane.done_s[soon]);
  EXPECT_LT(plane.done_s[soon], plane.done_s[late]);
  EXPECT_LT(plane.done_s[late], plane.done_s[whenever]);
}

TEST(FairQueue, WhatIsOwedWaitsForAllUntilItIsDueAndThenForNobody) {
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

TEST(FairQueue, WhatIsOwedIsDoneInTimeUnderAnOverloadOfPublications) {
  Plane plane;
  double next_s = 1000;
  std::vector<std::pair<FairQueue::Id, double>> owed;
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
    EXPECT_LE(plane.done_s[id], deadline_s + FairQueue::kSliceS + 1e-6);
  }
}

TEST(FairQueue, WhatIsOwedIsChargedToItsClient) {
  Plane plane;
  plane.add("publisher", 100);
  plane.add("other", 100);
  const auto owed = plane.add("publisher", 2, 1001, true);
  plane.run(1001);
  const auto later = plane.add("third", 0.01);
  plane.run(1006);
  EXPECT_TRUE(plane.done_s.contains(owed));
  EXPECT_TRUE(plane.done_s.contains(later));
  const auto next = plane.queue.next(Plane::at(1003));
  ASSERT_TRUE(next.has_value());
}

TEST(FairQueue, BoundedForEachClientAndInAll) {
  Plane plane;
  for (std::size_t k = 0; k < FairQueue::kMaxWaitingPerClient; ++k) plane.add("greedy", 60);
  EXPECT_EQ(kind_of([&] { plane.add("greedy", 60); }), ErrorKind::kExhausted);
  EXPECT_NO_THROW(plane.add("fair", 1));  // its place is its own
  std::size_t all = FairQueue::kMaxWaitingPerClient + 1;
  for (int client = 0; all < FairQueue::kMaxWaiting; ++all, ++client)
    plane.add("client " + std::to_string(client), 1);
  EXPECT_EQ(kind_of([&] { plane.add("one too many", 1); }), ErrorKind::kExhausted);
  EXPECT_NO_THROW(plane.add("one too many", 1, 1001, true));  // debts are bounded by who owes
}

TEST(FairQueue, NoMoreAreBegunThanStatedButWhatIsOwedStillIs) {
  Plane plane;
  std::vector<FairQueue::Id> begun;
  for (std::size_t k = 0; k < FairQueue::kMaxBegun; ++k) plane.add("client " + std::to_string(k), 100);
  plane.run(1002);  // every one has had its first turn
  const auto waits = plane.add("late", 0.1), owed = plane.add("late", 0.1, 1003, true);
  plane.run(1010);
  EXPECT_FALSE(plane.done_s.contains(waits));
  EXPECT_TRUE(plane.done_s.contains(owed));
}

TEST(FairQueue, WhatCannotBeginBeforeItsDeadlineExpires) {
  Plane plane;
  plane.add("a", 10);
  plane.run(1001);
  const auto late = plane.add("a", 1, 1005);
  plane.add("a", 1, 1004, true);
  EXPECT_TRUE(plane.queue.expired(Plane::at(1004.9)).empty());
  EXPECT_EQ(plane.queue.expired(Plane::at(1005)), std::vector<FairQueue::Id>{late});
  plane.queue.ended(late, Plane::at(1005));
  EXPECT_TRUE(plane.queue.expired(Plane::at(1006)).empty());
}

TEST(FairQueue, TellsWhenAJobCouldBeDone) {
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

TEST(FairQueue, WhatWasToldIsKept) {
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
    EXPECT_LE(plane.done_s[mine] - 1001, told_s + (others + 1) * FairQueue::kSliceS) << others;
    EXPECT_GE(plane.done_s[mine] - 1001, 0.5 * told_s) << others;
  }
}

}  // namespace
}  // namespace teletact::service
