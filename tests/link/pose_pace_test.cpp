// When poses go out: by a clock that is given, and through a whole stream on such a clock.
#include "client/link/pose_pace.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <memory>
#include <thread>
#include <utility>
#include <vector>

#include "tests/link/operator.h"

namespace teletact::client {
namespace {

using test::FakeAccount;
using test::FakePalpation;

constexpr std::int64_t kUs = 1000, kMs = 1'000'000, kSecond = 1'000'000'000;

// A servo that gives a pose each millisecond, and the writer of its stream.
struct Writing {
  std::int64_t servo_until_ns = 10 * kSecond;
  std::int64_t late_ns = 0;  // each third time
  std::int64_t room_until_ns = 10 * kSecond;
  double round_trip_s = 0;
};

// When poses went out, within `until_ns`.
std::vector<std::int64_t> poses(std::int64_t until_ns, double interval_s, const Writing& writing) {
  constexpr std::int64_t kBegin = 7 * kSecond;
  PosePace pace(kBegin);
  std::vector<std::int64_t> sent;
  std::int64_t seen = -1;
  for (std::int64_t t = 0; t < until_ns; t += 10 * kUs) {
    const std::int64_t now_ns = kBegin + t;
    const std::int64_t late_ns = sent.size() % 3 == 1 ? writing.late_ns : 0;
    if (now_ns < pace.due_ns(t < writing.room_until_ns, writing.round_trip_s) + late_ns) continue;
    const std::int64_t given = std::min(t, writing.servo_until_ns) / kMs;
    if (!pace.worth_sending(std::exchange(seen, given) != given, now_ns)) {
      pace.look_again(now_ns);
      continue;
    }
    pace.sent(interval_s, now_ns);
    sent.push_back(t);
  }
  return sent;
}

TEST(PosePace, IsAsQuickAsTheLinkButNotWhileALawIsFelt) {
  EXPECT_EQ(PosePace::interval_s(0.004, false, false), 0.004);
  EXPECT_EQ(PosePace::interval_s(0.0002, false, true), 0.001);
  EXPECT_EQ(PosePace::interval_s(0.004, true, false), 0.05);
  EXPECT_EQ(PosePace::interval_s(0.004, true, true), 0.02);
  EXPECT_EQ(PosePace::interval_s(0.2, true, true), 0.2);
}

TEST(PosePace, GivesAPoseEachIntervalAndNoneLess) {
  for (const double interval_s : {0.05, 0.02, 0.004})
    EXPECT_EQ(double(poses(2 * kSecond, interval_s, {}).size()), 2 / interval_s);
}

TEST(PosePace, MakesUpForALateWakeUpWithoutABurst) {
  EXPECT_NEAR(double(poses(10 * kSecond, 0.05, {.late_ns = 20 * kMs}).size()), 200, 1);
  const auto sent = poses(10 * kSecond, 0.05, {.late_ns = 200 * kMs});
  for (std::size_t k = 1; k < sent.size(); ++k) EXPECT_GE(sent[k] - sent[k - 1], 25 * kMs) << k;
}

// GIVEN a servo that stops after 20 ms THEN the pose that it gave last goes out each tenth of a second.
TEST(PosePace, RepeatsAPoseAsAHeartbeatAlone) {
  const auto sent = poses(kSecond, 0.002, {.servo_until_ns = 20 * kMs});
  ASSERT_EQ(sent.size(), 11u + 9u);
  for (std::size_t k = 11; k < sent.size(); ++k) EXPECT_EQ(sent[k] - sent[k - 1], 100 * kMs) << k;
}

// GIVEN a link without room for another pose THEN heartbeats go out, no sooner than a round trip apart.
TEST(PosePace, SendsHeartbeatsThroughALinkWithoutRoom) {
  for (const double round_trip_s : {0.0, 0.03, 0.4}) {
    const auto sent = poses(4 * kSecond, 0.002, {.room_until_ns = kMs, .round_trip_s = round_trip_s});
    ASSERT_GE(sent.size(), 9u);
    for (std::size_t k = 1; k < sent.size(); ++k)
      EXPECT_NEAR(double(sent[k] - sent[k - 1]), 1e9 * (0.0015 + std::max(0.1, round_trip_s)), 0.5e6)
          << round_trip_s;
  }
}

// Of a servo and its link: stands still until it is told to go on.
class GivenClock final : public Clock {
 public:
  std::int64_t now_ns() noexcept override { return time_ns_; }
  void sleep_until_ns(std::int64_t) noexcept override {}
  void pass(std::int64_t ns) { time_ns_ += ns; }

 private:
  std::atomic<std::int64_t> time_ns_{kSecond};
};

// A stream with one pose in flight at most.
class OnAGivenClock : public testing::Test {
 protected:
  void SetUp() override {
    service.credit = 1;
    service.serve();
  }
  void open(bool tactile = false) {
    TouchLinkOptions options;
    options.address = test::socket_address("given");
    options.open.set_scene_id("s");
    options.open.set_period_s(0.001);
    options.open.set_credit(1);
    if (tactile) options.open.mutable_tactile();
    link = std::make_unique<TouchLink>(options, given, answers, clock);
    link->start();
  }
  // A pose, and then time.
  void give(std::int64_t passes_ns) {
    ServoPose pose;
    pose.pose.position_m = Vector3(newest_m += 1e-6, 0.004, 0);
    pose.time_ns = clock.now_ns();
    pose.by_law = by_law;
    given.put(pose);
    clock.pass(passes_ns);
  }
  // That one more has come, the newest, and is answered.
  void expect_newest() {
    ++expected;
    ASSERT_TRUE(service.wait_until([&](const FakeAccount& account) { return account.poses >= expected; }));
    EXPECT_EQ(service.account().poses, expected);
    EXPECT_EQ(service.last_pose().position_m(0), newest_m);
    if (service.silent) return;
    ASSERT_TRUE(test::within(10, [&] { return link->stats().answers == expected; }));
  }
  // A pose is sent when one interval has passed, and none before.
  void expect_interval(std::int64_t ns) {
    // Two that are late, whenever the stream was opened; then one that makes up for it, as far as may be.
    for (const std::int64_t passes_ns : {3 * ns, 3 * ns, ns / 2}) give(passes_ns), expect_newest();
    for (int k = 0; k < 3; ++k) {
      give(ns - ns / 10);
      std::this_thread::sleep_for(std::chrono::nanoseconds(ns + ns / 10));  // in which it could be sent
      give(ns / 10), expect_newest();
    }
  }
  FakePalpation service{test::socket_address("given")};
  GivenClock clock;
  LatestSlot<ServoPose> given;
  LatestSlot<ServoAnswer> answers;
  bool by_law = false;
  double newest_m = 0.02;
  std::uint64_t expected = 0;
  std::unique_ptr<TouchLink> link;
};

// GIVEN a service that takes 40 poses' time for an answer THEN the next pose that it gets is the last of
// them.
TEST_F(OnAGivenClock, TheNewestPoseWins) {
  open();
  for (int k = 0; k < 10; ++k) {
    service.speak(false);
    give(100 * kMs), expect_newest();
    for (int ms = 0; ms < 40; ++ms) give(kMs);
    service.speak(true);
    expect_newest();
  }
}

TEST_F(OnAGivenClock, PosesGoOutAsOftenAsAgreed) {
  open();
  expect_interval(kMs);
}

// Whatever the versions of the windows that answer: the servo says whether it follows answers.
TEST_F(OnAGivenClock, PosesAreFewWhileAContactLawIsFelt) {
  open();
  by_law = true;
  expect_interval(50 * kMs);
}

// Images come with answers.
TEST_F(OnAGivenClock, PosesAreAsManyAsTactileImagesByALaw) {
  open(true);
  by_law = true;
  expect_interval(20 * kMs);
}

}  // namespace
}  // namespace teletact::client
