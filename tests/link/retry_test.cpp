#include "client/link/retry.h"

#include <gtest/gtest.h>

namespace teletact::client {
namespace {

TEST(Backoff, DoublesUpToTheLongestAndStartsOver) {
  Backoff backoff(0.1, 0.5);
  for (const double expected_s : {0.1, 0.2, 0.4, 0.5, 0.5, 0.5})
    EXPECT_DOUBLE_EQ(backoff.next_s(), expected_s);
  backoff.restart();
  EXPECT_DOUBLE_EQ(backoff.next_s(), 0.1);
}

}  // namespace
}  // namespace teletact::client
