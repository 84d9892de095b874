// What took too long is one line, however much of it there is, on a given clock.
#include "service/trace/slow_log.h"

#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>

#include <memory>
#include <new>
#include <sstream>
#include <string>

namespace teletact::service {
namespace {

using std::chrono::milliseconds;

class SlowLogs : public testing::Test {
 protected:
  SlowLogs() {
    auto own =
        std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(lines_));
    own->set_pattern("%l %v");
    spdlog::set_default_logger(own);
  }
  ~SlowLogs() override { spdlog::set_default_logger(before_); }
  // What is said of one that is told of so late.
  std::string said_at(milliseconds time) {
    lines_.str("");
    log.tell(SlowLog::Clock::time_point(time), [] { return "method=m"; });
    return lines_.str();
  }
  SlowLog log{"slow_call", milliseconds(50), milliseconds(1000)};

 private:
  std::ostringstream lines_;
  const std::shared_ptr<spdlog::logger> before_ = spdlog::default_logger();
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
