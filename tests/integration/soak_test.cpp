// The soak for a minute, as a process beside a service of its own: what its hour promises, with the bounds of
// a busy machine.
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>

#include "tests/integration/process.h"

namespace teletact {
namespace {

// By how much the least of the second half of {time, bytes} is more than that of the first.
double kept_in_the_end(const nlohmann::json& samples) {
  const auto least = [&](std::size_t begin, std::size_t end) {
    double out = std::numeric_limits<double>::infinity();
    for (std::size_t k = begin; k < end; ++k) out = std::min(out, samples.at(k).at(1).get<double>());
    return out;
  };
  return least(samples.size() / 2, samples.size()) - least(0, samples.size() / 2);
}

TEST(Soak, AMinuteOfEverythingAtOnce) {
  constexpr double kReadyS = 300, kSoakS = 600;
  constexpr double kMaxInUseBytes = 32e6;  // between windows: three runs had 3 MB at most
  constexpr double kMaxKeptBytes = 64e6;   // resident once free memory is given back, every 10 s
  constexpr double kMaxPeakBytes = 192e6;  // resident in between: two runs had 127 and 138 MB
  const test::TemporaryFolder folder;
  const std::string address = "unix:" + (folder / "s"), admin = "unix:" + (folder / "a"),
                    json_file = folder / "soak.json";
  test::Process service({test::service_binary(), "serve", "--listen", address, "--admin", admin},
                        folder / "service.log");
  ASSERT_TRUE(service.says("serving on", kReadyS)) << service.output();
  const auto soak =
      test::run({test::required_environment("TELETACT_BINARY_DIR") + "/bench/teletact-bench", "soak",
                 "--service", address, "--admin", admin, "--quick", "--json", json_file},
                folder / "soak.log", {}, kSoakS);
  ASSERT_TRUE(soak.code == 0 || soak.code == 1) << soak.output;  // 1: an hour's promise, on a busy machine
  std::ifstream file(json_file);
  const auto result = nlohmann::json::parse(file, nullptr, false);
  ASSERT_TRUE(result.is_object()) << soak.output;
  const auto& touched = result.at("touch");
  EXPECT_EQ(touched.at("ended"), 0) << touched.at("ends");
  EXPECT_EQ(touched.at("without_force"), 0);
  for (const char* phase : {"imaging", "idle", "busy_cores"})
    EXPECT_GT(touched.at(phase).at("latency_s").at("count"), 1000) << phase;
  const auto spread = [&](const char* held) {
    return result.at(held).at("most").get<double>() - result.at(held).at("least").get<double>();
  };
  EXPECT_LT(spread("memory"), kMaxInUseBytes);
  EXPECT_LT(spread("resident"), kMaxPeakBytes);
  EXPECT_LT(kept_in_the_end(result.at("resident").at("samples")), kMaxKeptBytes);
  for (const char* held : {"resident", "descriptors", "threads"}) {
    EXPECT_GT(result.at(held).at("samples").size(), 100) << held;
    EXPECT_GT(result.at(held).at("least"), 0) << held;
  }
  EXPECT_GT(result.at("memory").at("samples").size(), 10);  // memory in use, between windows
  EXPECT_LT(result.at("memory").at("most"), result.at("resident").at("most"));
  std::size_t answered = 0;
  for (const auto& client : result.at("fair"))
    answered += client.at("published").get<std::size_t>() + client.at("refused").get<std::size_t>();
  EXPECT_GT(answered, 0U);
  for (const char* code : {"INTERNAL", "UNKNOWN"})
    EXPECT_EQ(result.dump().find(code), std::string::npos) << result;
  EXPECT_TRUE(service.running()) << service.output();
}

}  // namespace
}  // namespace teletact
