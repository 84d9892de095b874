#include "service/touch_plane/touch_exchange.h"

#include <gtest/gtest.h>

namespace teletact::service {
namespace {

TEST(Mailbox, NewestValueWins) {
  Mailbox<int> mailbox;
  EXPECT_FALSE(mailbox.put(1));
  EXPECT_TRUE(mailbox.put(2));
  EXPECT_TRUE(mailbox.put(3));
  EXPECT_EQ(mailbox.newest(), 3);
  EXPECT_EQ(mailbox.take(), 3);
  EXPECT_EQ(mailbox.take(), std::nullopt);
  EXPECT_FALSE(mailbox.put(4)) << "the last was taken";
}

}  // namespace
}  // namespace teletact::service
