// The threads of a schedule: one works with a device at a time, gives way at its looks, ends when it is to;
// in the background one after the other, in turns of those whose the jobs are.
#include "service/scene/workers.h"

#include <gtest/gtest.h>
#include <pthread.h>

#include <algorithm>
#include <atomic>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "service/device/cancellation.h"
#include "service/scene/errors.h"
#include "tests/scene/error_kind.h"

namespace teletact::service {
namespace {

using Clock = Workers::Clock;
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

TEST(Workers, ShortJobIsDoneWhileALongOneOfAnotherClientGoesOn) {
  Workers workers;
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

TEST(Workers, CancelledJobsEndAtTheirNextLookOrAtOnce) {
  Workers workers;
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

TEST(Workers, PausedJobCanBeCancelled) {
  Workers workers;
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

TEST(Workers, DeadlineEndsWhatRunsAndWhatWaits) {
  Workers workers;
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

// While the first is told, the second's device is free, and its thread ends it.
TEST(Workers, JobsThatExpireAtOnceOnTwoDevicesEndOnce) {
  Workers workers;
  std::atomic<bool> over{false}, free{false};
  std::atomic<int> ended{0};
  std::promise<void> begun, second;
  const auto on = [](std::size_t device, Clock::time_point deadline = Clock::time_point::max()) {
    JobTerms terms = of("a");
    terms.device = device, terms.deadline = deadline;
    return terms;
  };
  auto held = workers.run(on(1), [&] {  // never looks
    begun.set_value();
    while (!free) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  });
  begun.get_future().wait();
  auto looks = workers.run(on(0), [&] { work_until([&] { return over.load(); }); });
  const auto late = Clock::now() + std::chrono::milliseconds(50);
  auto second_ended = second.get_future();
  workers.post(
      on(0, late), [] {},
      [&](const std::exception_ptr&) {
        free = true;
        EXPECT_EQ(second_ended.wait_for(kLong), std::future_status::ready);
        over = true;
      });
  workers.post(
      on(1, late), [] {},
      [&](const std::exception_ptr&) {
        if (ended++ == 0) second.set_value();
      });
  looks.future.get();
  held.future.get();
  EXPECT_EQ(ended, 1);
}

TEST(Workers, WhatIsOwedRunsByItsDeadlineBesideWorkThatNeverEnds) {
  Workers workers;
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

constexpr int kScene = 0;

TEST(Workers, WhoNeedsWhatAnotherHasGoesOnWhenThatIsGivenBack) {
  Workers workers;
  std::atomic<bool> taken{false}, enough{false}, ended{false}, ended_before{false};
  auto other = workers.run(never_due(), [&] {
    workers.do_alone(&kScene, kLong, [&] {
      taken = true;
      work_until([&] { return enough.load(); });
      ended = true;
    });
  });
  while (!taken) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  auto endless = workers.run(of("greedy"), [] { work_until([] { return false; }); });
  auto needs = workers.run(of("fair"), [&] {
    enough = true;
    EXPECT_TRUE(workers.do_alone(&kScene, {}, [&] { ended_before = ended.load(); })) << "of the same device";
    return waited_s();
  });
  ASSERT_EQ(needs.future.wait_for(kLong), std::future_status::ready);
  EXPECT_TRUE(ended_before);
  EXPECT_GT(needs.future.get(), 0);
  workers.cancel(endless.id);
}

TEST(Workers, WhoNeedsWhatAnotherHasCanBeCancelled) {
  Workers workers;
  std::atomic<bool> taken{false}, needed{false}, done{false};
  auto other = workers.run(never_due(), [&] {
    workers.do_alone(&kScene, kLong, [&] {
      taken = true;
      work_until([] { return false; });
    });
  });
  while (!taken) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  auto needs = workers.run(of("fair"), [&] {
    needed = true;
    workers.do_alone(&kScene, kLong, [&] { done = true; });
  });
  while (!needed) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  workers.cancel(needs.id);
  ASSERT_EQ(needs.future.wait_for(kLong), std::future_status::ready);
  EXPECT_EQ(kind_of([&] { needs.future.get(); }), ErrorKind::kCancelled);
  EXPECT_FALSE(done);
  workers.cancel(other.id);
  EXPECT_EQ(kind_of([&] { other.future.get(); }), ErrorKind::kCancelled);
  workers.run(of("fair"), [&] { workers.do_alone(&kScene, kLong, [&] { done = true; }); }).future.get();
  EXPECT_TRUE(done) << "who was cancelled has given it back";
}

TEST(Workers, DevicesWorkBesideEachOther) {
  Workers workers;
  std::promise<void> release;
  const auto first = workers.run({}, [&] { release.get_future().wait(); });
  JobTerms terms;
  terms.device = 1;
  auto second = workers.run(terms, [&] { return workers.device_here(); });
  ASSERT_EQ(second.future.wait_for(kLong), std::future_status::ready);
  EXPECT_EQ(second.future.get(), 1U);
  EXPECT_THROW(workers.device_here(), std::logic_error);
  release.set_value();
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

TEST(Workers, WhoMadeWayForAJobWithoutAThreadTriesAgain) {
  Workers workers;
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

TEST(Workers, StopEndsEverythingAndRefusesMore) {
  Workers workers;
  auto running = workers.run(of("a"), [] { work_until([] { return false; }); });
  auto waiting = workers.run(of("a"), [] {});
  workers.stop();
  EXPECT_EQ(kind_of([&] { running.future.get(); }), ErrorKind::kUnavailable);
  EXPECT_EQ(kind_of([&] { waiting.future.get(); }), ErrorKind::kUnavailable);
  EXPECT_EQ(kind_of([&] { workers.run(of("a"), [] {}); }), ErrorKind::kUnavailable);
}

TEST(Workers, JobsOfManyClientsAllEndAndLeaveNothing) {
  Workers workers;
  std::atomic<int> done{0};
  std::vector<Workers::Running<void>> all;
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

TEST(Workers, SayHowLongWhoeverWorksHasNotLookedUp) {
  Workers workers;
  EXPECT_EQ(workers.silent_s(0), 0);
  std::atomic<bool> looks{false}, enough{false};
  const auto hung = workers.run(of("a"), [&] {
    while (!enough) {
      if (looks) check_cancelled();
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  });
  while (workers.silent_s(0) < 0.2) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  looks = true;
  while (workers.silent_s(0) > 0.1) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  enough = true;
  hung.future.wait();
  EXPECT_EQ(workers.silent_s(0), 0);
}

// Jobs that wait behind one that ends with go().
class InTheBackground : public testing::Test {
 protected:
  InTheBackground() {
    worker.post([going = going.get_future().share()] { going.wait(); });
  }
  Workers::Id post(const std::string& name, const std::string& of) {
    return worker.post([this, name] { done.push_back(name); }, of);
  }
  void go() {
    going.set_value();
    worker.finish();
  }
  std::vector<std::string> done;
  std::promise<void> going;
  Workers worker;
};

TEST_F(InTheBackground, OwnersTakeTurnsAndKeepTheirOrder) {
  for (const char* name : {"a1", "a2", "a3"}) post(name, "a");
  for (const char* name : {"b1", "b2"}) post(name, "b");
  post("c1", "c");
  go();
  EXPECT_EQ(done, (std::vector<std::string>{"a1", "b1", "c1", "a2", "b2", "a3"}));
}

TEST_F(InTheBackground, AJobThatIsDroppedIsNotDoneAndHoldsNothing) {
  const auto held = std::make_shared<int>();
  const auto dropped = worker.post([this, held] { done.emplace_back("dropped"); }, "a");
  post("other", "a");
  worker.cancel(dropped);
  EXPECT_EQ(held.use_count(), 1);
  worker.cancel(dropped);  // once more: nothing
  go();
  EXPECT_EQ(done, std::vector<std::string>{"other"});
}

TEST(Workers, WhoWaitsForAJobThatIsDroppedAtTheEndMayDropItToo) {
  Workers worker;
  std::promise<void> begun, going;
  worker.post([&] {
    begun.set_value();
    going.get_future().wait();
  });
  begun.get_future().wait();
  bool dropped = false;
  std::shared_ptr<void> last(nullptr, [&](void*) {
    worker.cancel(2);
    dropped = true;
  });
  EXPECT_EQ(worker.post([last] {}), 2U);
  last.reset();
  std::thread stopping([&] { worker.stop(); });
  std::this_thread::sleep_for(std::chrono::milliseconds(20));  // it has begun to stop, most likely
  going.set_value();
  stopping.join();
  EXPECT_TRUE(dropped);
}

}  // namespace
}  // namespace teletact::service
