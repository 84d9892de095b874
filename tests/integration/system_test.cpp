// The whole system, as three processes: RF goes in on one side, force comes out on the other, and the report
// says what happened.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/integration/process.h"

namespace teletact {
namespace {

constexpr const char* kTissue =
    "seed = 5\n"
    "[tissue]\nwidth_m = 0.12\ndepth_m = 0.04\n"
    "[[inclusion]]\nposition_m = [0.062, 0.013]\ndiameter_m = 0.012\ncontrast = 5.0\n";

TEST(System, AnInclusionInRfIsFoundAndFeltAndTheReportSaysSo) {
  test::TemporaryFolder folder;
  const std::string address = "unix:" + (folder / "s"), client = test::client_binary();
  std::ofstream(folder / "t.toml") << kTissue;
  test::Process service({test::service_binary(), "serve", "--listen", address}, folder / "service.log");
  ASSERT_TRUE(service.says("serving on", 300)) << service.output();
  test::Process acquire({client, "acquire", "--service", address, "--scene", "a", "--tissue",
                         folder / "t.toml", "--passes-prepared", "2", "--record", folder / "acquire.record",
                         "--ready-file", folder / "ready", "--until-finger-leaves"},
                        folder / "acquire.log");
  for (int k = 0; k < 6000 && acquire.running() && !std::filesystem::exists(folder / "ready"); ++k)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  ASSERT_TRUE(std::filesystem::exists(folder / "ready")) << acquire.output();
  const test::Outcome touch =
      test::run({client, "touch", "--service", address, "--scene", "a", "--begin-m", "0.02", "--end-m",
                 "0.10", "--duration-s", "2.5", "--record", folder / "touch.record"},
                folder / "touch.log");
  ASSERT_EQ(touch.code, 0) << touch.output;
  EXPECT_EQ(acquire.wait(20), 0) << acquire.output();  // the finger has left
  const test::Outcome report =
      test::run({client, "report", "--tissue", folder / "t.toml", "--touch-record", folder / "touch.record",
                 "--acquire-record", folder / "acquire.record", "--out", folder / "out"},
                folder / "report.log");
  ASSERT_TRUE(report.code == 0 || report.code == 2) << report.output;  // 2: a figure of speed was missed
  for (const char* file : {"modulus.png", "force.png", "latency.png", "periods.png"})
    EXPECT_TRUE(std::filesystem::exists(folder / (std::string("out/") + file))) << file;
  const nlohmann::json summary = nlohmann::json::parse(std::ifstream(folder / "out/summary.json"));
  EXPECT_GE(summary["windows"].get<int>(), 2);
  EXPECT_EQ(summary["stalls"]["count"].get<int>(), 0) << "both windows were known before the touch";
  EXPECT_EQ(summary["inclusions"]["missed"].get<int>(), 0) << report.output;
  EXPECT_EQ(summary["inclusions"]["false"].size(), 0u) << report.output;
  EXPECT_LE(summary["force_error"]["median"].get<double>(), 0.10) << report.output;
  EXPECT_GE(summary["force_error"]["coverage"].get<double>(), 0.90) << report.output;
  EXPECT_GE(summary["touch_rate_hz"].get<double>(), 100) << report.output;
  EXPECT_FALSE(summary["device"]["name"].get<std::string>().empty());
}

}  // namespace
}  // namespace teletact
