#include "service/touch_plane/mailbox.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>

namespace teletact::service {
namespace {

const auto kAlways = [] { return true; };
const auto kNever = [] { return false; };
using Clock = Mailbox<int>::Clock;

TEST(Mailbox, NewestValueWins) {
  Mailbox<int> mailbox;
  EXPECT_FALSE(mailbox.put(1));
  EXPECT_TRUE(mailbox.put(2));
  EXPECT_TRUE(mailbox.put(3));
  EXPECT_EQ(mailbox.take(Clock::now(), kAlways, kNever), 3);
  EXPECT_EQ(mailbox.take(Clock::now(), kAlways, kNever), std::nullopt);
}

TEST(Mailbox, KeepsTheValueUntilTheTakerIsReady) {
  Mailbox<int> mailbox;
  mailbox.put(1);
  EXPECT_EQ(mailbox.take(Clock::now(), kNever, kNever), std::nullopt);
  EXPECT_EQ(mailbox.take(Clock::now(), kAlways, kNever), 1);
}

TEST(Mailbox, StopWinsOverAValue) {
  Mailbox<int> mailbox;
  mailbox.put(1);
  EXPECT_EQ(mailbox.take(Clock::time_point::max(), kAlways, kAlways), std::nullopt);
}

TEST(Mailbox, TakerNeverSeesAnOlderValueAfterANewerOne) {
  Mailbox<int> mailbox;
  constexpr int kLast = 20000;
  std::thread bringer([&] {
    for (int n = 1; n <= kLast; ++n) mailbox.put(n);
  });
  int seen = 0;
  while (seen < kLast) {
    const auto value = mailbox.take(Clock::time_point::max(), kAlways, kNever);
    ASSERT_TRUE(value.has_value());
    ASSERT_GT(*value, seen);
    seen = *value;
  }
  bringer.join();
}

TEST(Mailbox, WakeLetsTheTakerLookAgain) {
  Mailbox<int> mailbox;
  std::atomic<bool> ready{false};
  mailbox.put(7);
  std::thread other([&] {
    ready = true;
    mailbox.wake();
  });
  EXPECT_EQ(mailbox.take(
                Clock::time_point::max(), [&] { return ready.load(); }, kNever),
            7);
  other.join();
}

}  // namespace
}  // namespace teletact::service
