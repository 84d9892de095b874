// Who tells of slow calls waits for no disk; what is too much is dropped and counted.
#include "service/trace/spans.h"

#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "tests/files/temporary_folder.h"
#include "tests/trace/short_disk.h"

namespace teletact::service {
namespace {

using std::chrono::milliseconds;

Span call(std::uint64_t number) {
  const auto now = Spans::Clock::now();
  return {{{7, number}, new_span_id(), 0}, "", Span::Call{{"s", "m"}, 0, ""}, now - milliseconds(5), now};
}

class SpansWritten : public testing::Test {
 protected:
  std::unique_ptr<Spans> make(const SpansOptions& options) const {
    return Spans::make(options, {"0.1.0", "1"});
  }
  std::vector<nlohmann::json> lines() const {
    std::istringstream text(client::content_of(path));
    std::vector<nlohmann::json> out;
    for (std::string line; std::getline(text, line);) out.push_back(nlohmann::json::parse(line));
    return out;
  }
  static void wait_for(const std::function<bool()>& met) {
    const auto end = Spans::Clock::now() + std::chrono::seconds(60);
    while (!met() && Spans::Clock::now() < end) std::this_thread::sleep_for(milliseconds(5));
  }
  client::TemporaryFolder folder;
  const std::filesystem::path path = folder / "spans.jsonl";
};

TEST_F(SpansWritten, NoneWithoutAFileAndThenNoTimesEither) {
  EXPECT_EQ(make({}), nullptr);
  EXPECT_THROW(make({"", 1.0, {}}), std::runtime_error);
  EXPECT_THROW(make({"", {}, 1.0}), std::runtime_error);
  for (const double wrong :
       {-1.0, 3601.0, std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    EXPECT_THROW(make({path, wrong, {}}), std::invalid_argument);
    EXPECT_THROW(make({path, {}, wrong}), std::invalid_argument);
  }
}

TEST_F(SpansWritten, WhatIsSlowFollowsTheOptions) {
  const auto usual = make({path, {}, {}});
  EXPECT_FALSE(usual->slow_call(milliseconds(999)));
  EXPECT_TRUE(usual->slow_call(milliseconds(1001)));
  EXPECT_FALSE(usual->slow_answer(milliseconds(49)));
  EXPECT_TRUE(usual->slow_answer(milliseconds(51)));
  const auto own = make({folder / "own", 0.25, 0.002});
  EXPECT_TRUE(own->slow_call(milliseconds(251)));
  EXPECT_TRUE(own->slow_answer(milliseconds(3)));
  EXPECT_FALSE(own->slow_answer(milliseconds(1)));
}

TEST_F(SpansWritten, AThousandAtOnceAreWrittenAndTheirTimesAreTheWallClocks) {
  const auto before = std::chrono::system_clock::now();
  constexpr std::uint64_t kThreads = 8, kEach = 125;
  auto spans = make({path, {}, {}});
  std::vector<std::thread> threads;
  for (std::uint64_t t = 0; t < kThreads; ++t)
    threads.emplace_back([&, t] {
      for (std::uint64_t k = 0; k < kEach; ++k) spans->tell([&] { return call(t * kEach + k); });
    });
  for (auto& thread : threads) thread.join();
  spans.reset();  // writes what waits
  const auto written = lines();
  EXPECT_EQ(written.size(), kThreads * kEach);
  const auto& first = written.at(0).at("resourceSpans").at(0).at("scopeSpans").at(0).at("spans").at(0);
  const std::chrono::nanoseconds begin(std::stoll(first.at("startTimeUnixNano").get<std::string>()));
  EXPECT_GT(begin, before.time_since_epoch() - std::chrono::seconds(1));
  EXPECT_LT(begin, std::chrono::system_clock::now().time_since_epoch());
}

TEST_F(SpansWritten, WhatIsTooMuchIsDroppedAndCounted) {
  auto spans = make({path, {}, {}});
  constexpr std::uint64_t kAll = 10 * Spans::kMostWaiting;
  for (std::uint64_t k = 0; k < kAll; ++k) spans->tell([&] { return call(k); });
  spans->tell([]() -> Span { throw std::bad_alloc(); });
  EXPECT_GT(spans->dropped(), 1U);
  wait_for([&] { return spans->written() + spans->dropped() == kAll + 1; });
  EXPECT_EQ(spans->written() + spans->dropped(), kAll + 1);
  EXPECT_EQ(lines().size(), spans->written());
}

TEST_F(SpansWritten, AFullDiskIsSaidOnceAndTriedAgain) {
  std::ostringstream said;
  const auto log = spdlog::default_logger();
  spdlog::set_default_logger(
      std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(said)));
  auto spans = make({path, {}, {}});
  {
    const ShortDisk disk(100);
    for (std::uint64_t round = 1; round <= 3; ++round) {
      for (int k = 0; k < 10; ++k) spans->tell([&] { return call(1); });
      wait_for([&] { return spans->dropped() == 10 * round; });
      EXPECT_EQ(spans->dropped(), 10 * round);
    }
  }
  spans->tell([&] { return call(2); });
  wait_for([&] { return spans->written() == 1; });
  {
    const ShortDisk disk(100);  // soon again: not worth another line
    spans->tell([&] { return call(3); });
    wait_for([&] { return spans->dropped() == 31; });
  }
  spans->tell([&] { return call(4); });
  spans.reset();
  spdlog::set_default_logger(log);
  EXPECT_EQ(lines().size(), 2U);
  const std::string text = said.str();
  const auto count = [&](const std::string& event) {
    std::size_t times = 0;
    for (std::size_t at = 0; (at = text.find(event, at)) != std::string::npos; ++at) ++times;
    return times;
  };
  EXPECT_EQ(count("event=spans_not_written"), 1U) << text;
  EXPECT_EQ(count("event=spans_written_again"), 1U) << text;
  EXPECT_EQ(count("event=spans_written_again dropped=30"), 1U) << text;
}

}  // namespace
}  // namespace teletact::service
