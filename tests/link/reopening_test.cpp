// How soon a stream is opened again: waits alone, no network and no clock.
#include "client/link/reopening.h"

#include <gtest/gtest.h>

#include <vector>

namespace teletact::client {
namespace {

constexpr double kNever = 0;  // lived

TEST(Reopening, WhatBrokeIsOpenedAgainAtOnceHoweverOften) {
  Reopening reopening;
  for (int k = 0; k < 20; ++k) EXPECT_EQ(reopening.after_end_s(false, k), 0.1);
}

TEST(Reopening, WhatIsRefusedIsTriedEverMoreSeldomButAtLeastEach5S) {
  Reopening reopening;
  for (const double wait_s : {0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 5.0})
    EXPECT_DOUBLE_EQ(reopening.after_end_s(true, kNever), wait_s);
}

TEST(Reopening, MovesAreFollowedEverMoreSeldomWhateverIsRefused) {
  Reopening reopening;
  for (const double wait_s : {0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 5.0, 5.0}) {
    EXPECT_DOUBLE_EQ(reopening.after_move_s(1), wait_s);
    reopening.after_end_s(true, kNever);
  }
}

TEST(Reopening, BeginsAnewOnceAStreamHasLivedFor5S) {
  Reopening reopening;
  for (int k = 0; k < 4; ++k) reopening.after_end_s(true, 4.9), reopening.after_move_s(4.9);
  EXPECT_DOUBLE_EQ(reopening.after_end_s(true, 4.9), 1.6);
  EXPECT_DOUBLE_EQ(reopening.after_move_s(4.9), 1.6);
  EXPECT_DOUBLE_EQ(reopening.after_end_s(true, 5.1), 0.1);
  EXPECT_DOUBLE_EQ(reopening.after_move_s(5.1), 0.1);
}

}  // namespace
}  // namespace teletact::client
