// How values pass between the servo thread and the others: LatestSlot and Ring.
#include <gtest/gtest.h>

#include <cstdint>
#include <thread>

#include "client/haptic/latest_slot.h"
#include "client/servo/ring.h"

namespace teletact::client {
namespace {

TEST(LatestSlot, TheNewestValueWins) {
  LatestSlot<int> slot;
  int value = -1;
  EXPECT_FALSE(slot.take(value));
  slot.put(1);
  slot.put(2);
  EXPECT_TRUE(slot.take(value));
  EXPECT_EQ(value, 2);
  EXPECT_FALSE(slot.take(value));
}

TEST(LatestSlot, NoValueIsTornBetweenThreads) {
  struct Wide {
    std::uint64_t words[16] = {};
  };
  LatestSlot<Wide> slot;
  constexpr std::uint64_t kCount = 200000;
  std::thread writer([&] {
    Wide wide;
    for (std::uint64_t n = 1; n <= kCount; ++n) {
      for (auto& word : wide.words) word = n;
      slot.put(wide);
    }
  });
  std::uint64_t last = 0;
  while (last < kCount) {
    Wide wide;
    if (!slot.take(wide)) continue;
    for (const auto word : wide.words) ASSERT_EQ(word, wide.words[0]);
    ASSERT_GT(wide.words[0], last);
    last = wide.words[0];
  }
  writer.join();
}

TEST(Ring, DropsAndCountsWhatDoesNotFit) {
  Ring<int, 4> ring;
  for (int n = 0; n < 6; ++n) ring.push(n);
  EXPECT_EQ(ring.dropped(), 2u);
  int value = -1;
  for (int n = 0; n < 4; ++n) {
    EXPECT_TRUE(ring.pop(value));
    EXPECT_EQ(value, n);
  }
  EXPECT_FALSE(ring.pop(value));
}

}  // namespace
}  // namespace teletact::client
