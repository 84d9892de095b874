// Lines of the log carry the trace that their thread works for.
#include "service/base/current_trace.h"

#include <gtest/gtest.h>
#include <spdlog/logger.h>
#include <spdlog/sinks/ostream_sink.h>

#include <functional>
#include <memory>
#include <regex>
#include <sstream>
#include <string>
#include <thread>

#include "service/base/log_formatter.h"

namespace teletact::service {
namespace {

TEST(CurrentTrace, StandsInTheLinesOfItsThreadWhileItLasts) {
  std::ostringstream lines;
  spdlog::logger log("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(lines));
  log.set_formatter(log_formatter());
  const auto said = [&](const char* event) {
    lines.str("");
    log.info("event={}", event);
    return lines.str();
  };
  const TraceId outer{0x4bf92f3577b34da6, 0xa3ce929d0e0e4736}, inner{0, 1};
  const std::string time = "time=[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9:]{8}\\.[0-9]{6}Z level=info ";
  const auto expect = [&](const std::string& line, const std::string& rest) {
    EXPECT_TRUE(std::regex_match(line, std::regex(time + rest + "\n"))) << line;
  };
  expect(said("before"), "event=before");
  {
    const InTrace call(outer);
    expect(said("call"), "event=call trace=4bf92f3577b34da6a3ce929d0e0e4736");
    std::thread([&] { expect(said("other"), "event=other"); }).join();
    {
      const InTrace given_way(inner);
      expect(said("inner"), "event=inner trace=00000000000000000000000000000001");
    }
    EXPECT_EQ(current_trace(), outer);
  }
  expect(said("after"), "event=after");
}

TEST(CurrentTrace, GoesWithTheJobThatIsPosted) {
  const TraceId call{1, 2};
  std::function<TraceId(int)> job;
  {
    const InTrace here(call);
    job = in_current_trace([](int) { return current_trace(); });
  }
  std::thread([&] {
    EXPECT_EQ(job(3), call);
    EXPECT_EQ(current_trace(), TraceId());
  }).join();
}

}  // namespace
}  // namespace teletact::service
