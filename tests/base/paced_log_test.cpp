// What took too long is one line, however much of it there is, on a given clock.
#include "service/base/paced_log.h"

#include <gtest/gtest.h>

#include <new>
#include <string>

#include "tests/support/kept_log.h"

namespace teletact::service {
namespace {

using std::chrono::milliseconds;

class SlowLogs : public testing::Test {
 protected:
  // What is said of one that is told of so late.
  std::string said_at(milliseconds time) {
    const test::KeptLog kept(test::KeptLog::by_pattern("%l %v"));
    log.tell(SlowLog::Clock::time_point(time), [] { return "method=m"; });
    return kept.text();
  }
  SlowLog log{"slow_call", milliseconds(50), milliseconds(1000)};
};

TEST_F(SlowLogs, SayOneOfASecondAndCountTheOthers) {
  EXPECT_EQ(said_at(milliseconds(0)), "warning event=slow_call method=m left_out=0\n");
  for (int ms = 0; ms < 1000; ++ms) EXPECT_EQ(said_at(milliseconds(ms)), "");
  log.leave_out();
  EXPECT_EQ(said_at(milliseconds(1000)), "warning event=slow_call method=m left_out=1001\n");
  EXPECT_EQ(said_at(milliseconds(2000)), "warning event=slow_call method=m left_out=0\n");
}

TEST_F(SlowLogs, TakeLongerThanTheirTime) {
  EXPECT_FALSE(log.too_long(milliseconds(50)));
  EXPECT_TRUE(log.too_long(milliseconds(51)));
}

TEST_F(SlowLogs, AreLostWhereThereIsNoMemoryForThem) {
  log.tell({}, []() -> std::string { throw std::bad_alloc(); });
}

TEST_F(SlowLogs, NameTheirStages) {
  EXPECT_EQ(key_values(milliseconds(1234), {}), "took_s=1.2340");
  EXPECT_EQ(key_values(milliseconds(1234), {{"upload", milliseconds(1200)}, {"taken", milliseconds(34)}}),
            "took_s=1.2340 upload_s=1.2000 taken_s=0.0340");
}

}  // namespace
}  // namespace teletact::service
