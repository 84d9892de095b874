// The imaging plane's threads: one works at a time, gives way at its looks, ends when it is to.
#include "service/imaging_plane/fair_workers.h"

#include <gtest/gtest.h>
#include <pthread.h>

#include <algorithm>
#include <atomic>
#include <functional>
#include <optional>
#include <system_error>
#include <thread>
#include <vector>

#include "service/device/cancellation.h"
#include "service/scene/errors.h"
#include "tests/imaging_plane/error_kind.h"

namespace teletact::service {
namespace {

using Clock = FairWorkers::Clock;
constexpr std::chrono::seconds kLong{60};  // far more than the busiest machine takes

JobTerms of(const std::string& client) {
  JobTerms terms;
  terms.client = client;
  return terms;
}

// Looks again and again until `until` says so.
void work_until(const std::function<bool()>& until) {
  while (!until()) {
    check_cancelled();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

TEST(FairWorkers, ShortJobIsDoneWhileALongOneOfAnotherClientGoesOn) {
  FairWorkers workers;
  std::atomic<bool> enough{false};
  std::atomic<int> at_once{0}, most{0};
  const auto alone = [&] {
    most = std::max<int>(most, ++at_once);
    --at_once;
  };
  auto greedy = workers.run(of("greedy"), [&] {
    work_until([&] {
      alone();
      return enough.load();
    });
    return waited_s();
  });
  for (int k = 0; k < 3; ++k) {
    auto fair = workers.run(of("fair"), [&] {
      for (int n = 0; n < 100; ++n) alone(), check_cancelled();
      return 7;
    });
    ASSERT_EQ(fair.future.wait_for(kLong), std::future_status::ready);
    EXPECT_EQ(fair.future.get(), 7);
    EXPECT_NE(greedy.future.wait_for(std::chrono::seconds(0)), std::future_status::ready);
  }
  enough = true;
  EXPECT_GT(greedy.future.get(), 0);  // it knows that it has waited
  EXPECT_EQ(most, 1);
}

TEST(FairWorkers, CancelledJobsEndAtTheirNextLookOrAtOnce) {
  FairWorkers workers;
  std::atomic<bool> began{false};
  auto running = workers.run(of("a"), [] { work_until([] { return false; }); });
  auto waiting = workers.run(of("a"), [&] { began = true; });
  workers.cancel(waiting.id);
  EXPECT_EQ(waiting.future.wait_for(std::chrono::seconds(0)), std::future_status::ready);
  EXPECT_EQ(kind_of([&] { waiting.future.get(); }), ErrorKind::kCancelled);
  workers.cancel(running.id);
  EXPECT_EQ(kind_of([&] { running.future.get(); }), ErrorKind::kCancelled);
  workers.cancel(running.id);  // ended: nothing
  EXPECT_FALSE(began);
}

TEST(FairWorkers, PausedJobCanBeCancelled) {
  FairWorkers workers;
  std::atomic<bool> enough{false};
  auto paused = workers.run(of("a"), [] { work_until([] { return false; }); });
  std::promise<void> begun;
  auto holder = workers.run(of("b"), [&] {  // never looks
    begun.set_value();
    while (!enough) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  });
  begun.get_future().wait();
  workers.cancel(paused.id);
  ASSERT_EQ(paused.future.wait_for(kLong), std::future_status::ready);
  EXPECT_EQ(kind_of([&] { paused.future.get(); }), ErrorKind::kCancelled);
  enough = true;
  holder.future.get();
}

TEST(FairWorkers, DeadlineEndsWhatRunsAndWhatWaits) {
  FairWorkers workers;
  std::atomic<bool> began{false}, enough{false};
  auto other = workers.run(of("other"), [&] { work_until([&] { return enough.load(); }); });
  JobTerms terms = of("a");
  terms.deadline = Clock::now() + std::chrono::milliseconds(200);
  auto running = workers.run(terms, [] { work_until([] { return false; }); });
  auto waiting = workers.run(terms, [&] { began = true; });
  EXPECT_EQ(kind_of([&] { running.future.get(); }), ErrorKind::kDeadline);
  ASSERT_EQ(waiting.future.wait_for(kLong), std::future_status::ready);
  EXPECT_EQ(kind_of([&] { waiting.future.get(); }), ErrorKind::kDeadline);
  EXPECT_FALSE(began);
  enough = true;
  other.future.get();
}

TEST(FairWorkers, WhatIsOwedRunsByItsDeadlineBesideWorkThatNeverEnds) {
  FairWorkers workers;
  auto endless = workers.run(of("greedy"), [] { work_until([] { return false; }); });
  JobTerms terms = of("fair");
  terms.owed = true;
  terms.deadline = Clock::now() + std::chrono::milliseconds(200);
  auto owed = workers.run(terms, [] { return true; });
  ASSERT_EQ(owed.future.wait_for(kLong), std::future_status::ready);
  EXPECT_TRUE(owed.future.get());
  workers.cancel(endless.id);
}

JobTerms never_due() {
  JobTerms terms = of("fair");
  terms.owed = true;
  return terms;
}

TEST(FairWorkers, WhoStepsAsideGoesOnWhenTheOtherHasEnded) {
  FairWorkers workers;
  std::atomic<bool> enough{false}, ended{false}, ended_before{false};
  auto other = workers.run(never_due(), [&] {
    work_until([&] { return enough.load(); });
    ended = true;
  });
  auto endless = workers.run(of("greedy"), [] { work_until([] { return false; }); });
  auto aside = workers.run(of("fair"), [&, id = other.id] {
    enough = true;
    for (int k = 0; k < 2; ++k) workers.step_aside(id);  // ended by then: nothing
    ended_before = ended.load();
    return waited_s();
  });
  ASSERT_EQ(aside.future.wait_for(kLong), std::future_status::ready);
  EXPECT_TRUE(ended_before);
  EXPECT_GT(aside.future.get(), 0);
  workers.cancel(endless.id);
}

TEST(FairWorkers, WhoStepsAsideCanBeCancelled) {
  FairWorkers workers;
  std::atomic<bool> aside_begun{false};
  auto other = workers.run(never_due(), [] { work_until([] { return false; }); });
  auto aside = workers.run(of("fair"), [&, id = other.id] {
    aside_begun = true;
    workers.step_aside(id);
  });
  while (!aside_begun) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  workers.cancel(aside.id);
  ASSERT_EQ(aside.future.wait_for(kLong), std::future_status::ready);
  EXPECT_EQ(kind_of([&] { aside.future.get(); }), ErrorKind::kCancelled);
  workers.cancel(other.id);
}

// While it lives no thread is to be had: each would get a larger stack than there are addresses.
class NoThreads {
 public:
  NoThreads() {
    pthread_getattr_default_np(&usual_);
    pthread_attr_t beyond;
    pthread_attr_init(&beyond);
    pthread_attr_setstacksize(&beyond, std::size_t{1} << 50);
    pthread_setattr_default_np(&beyond);
    pthread_attr_destroy(&beyond);
    EXPECT_THROW(std::thread([] {}).join(), std::system_error);
  }
  ~NoThreads() {
    pthread_setattr_default_np(&usual_);
    pthread_attr_destroy(&usual_);
  }
  NoThreads(const NoThreads&) = delete;
  NoThreads& operator=(const NoThreads&) = delete;

 private:
  pthread_attr_t usual_;
};

TEST(FairWorkers, WhoMadeWayForAJobWithoutAThreadTriesAgain) {
  FairWorkers workers;
  std::atomic<bool> enough{false};
  std::atomic<Clock::time_point> looked{Clock::now()};
  auto greedy = workers.run(of("greedy"), [&] {
    work_until([&] {
      looked = Clock::now();
      return enough.load();
    });
  });
  std::optional<NoThreads> full(std::in_place);
  auto other = workers.run(of("other"), [&] { enough = true; });
  const auto until = Clock::now() + kLong;
  while (Clock::now() - looked.load() < std::chrono::milliseconds(300) && Clock::now() < until)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_FALSE(enough);
  full.reset();
  ASSERT_EQ(other.future.wait_for(kLong), std::future_status::ready);
  ASSERT_EQ(greedy.future.wait_for(kLong), std::future_status::ready);
}

TEST(FairWorkers, StopEndsEverythingAndRefusesMore) {
  FairWorkers workers;
  auto running = workers.run(of("a"), [] { work_until([] { return false; }); });
  auto waiting = workers.run(of("a"), [] {});
  workers.stop();
  EXPECT_EQ(kind_of([&] { running.future.get(); }), ErrorKind::kUnavailable);
  EXPECT_EQ(kind_of([&] { waiting.future.get(); }), ErrorKind::kUnavailable);
  EXPECT_EQ(kind_of([&] { workers.run(of("a"), [] {}); }), ErrorKind::kUnavailable);
}

TEST(FairWorkers, JobsOfManyClientsAllEndAndLeaveNothing) {
  FairWorkers workers;
  std::atomic<int> done{0};
  std::vector<FairWorkers::Running<void>> all;
  for (int k = 0; k < 200; ++k) {
    try {
      all.push_back(workers.run(of("client " + std::to_string(k % 12)), [&] {
        for (int n = 0; n < 20; ++n) check_cancelled();
        ++done;
      }));
    } catch (const Error& error) {  // full: the plane catches up
      EXPECT_EQ(error.kind, ErrorKind::kExhausted);
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    if (k % 5 == 0 && !all.empty()) workers.cancel(all.back().id);
  }
  int well = 0;
  for (auto& running : all) {
    ASSERT_EQ(running.future.wait_for(kLong), std::future_status::ready);
    try {
      running.future.get();
      ++well;
    } catch (const Error& error) {
      EXPECT_EQ(error.kind, ErrorKind::kCancelled);
    }
  }
  EXPECT_EQ(well, done);
  EXPECT_GT(well, 50);
}

TEST(FairWorkers, SayHowLongWhoeverWorksHasNotLookedUp) {
  FairWorkers workers;
  EXPECT_EQ(workers.silent_s(), 0);
  std::atomic<bool> looks{false}, enough{false};
  const auto hung = workers.run(of("a"), [&] {
    while (!enough) {
      if (looks) check_cancelled();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
  while (workers.silent_s() < 0.2) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  looks = true;
  while (workers.silent_s() > 0.1) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  enough = true;
  hung.future.wait();
  EXPECT_EQ(workers.silent_s(), 0);
}

}  // namespace
}  // namespace teletact::service
