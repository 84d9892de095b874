// Pages of results are made of what the benches wrote, and of nothing else.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "tests/integration/process.h"

namespace teletact {
namespace {

constexpr double kReportS = 60;

std::string text_of(const std::filesystem::path& file) {
  std::stringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

auto report(const test::TemporaryFolder& folder, const std::string& json) {
  const std::string file = folder / "result.json";
  std::ofstream(file) << json;
  return test::run({test::required_environment("TELETACT_BINARY_DIR") + "/bench/teletact-bench", "report",
                    file, "--out", folder / "pages"},
                   folder / "report.log", {}, kReportS);
}

TEST(Results, APageHoldsTheMachineThePromisesAndTheTables) {
  const test::TemporaryFolder folder;
  const auto finished = report(folder, R"({"suite": "reach", "quick": false, "clients": 4,
    "machine": {"date": "2026-11-21", "version": "0.1.0", "cores": 2},
    "targets": [{"name": "reach", "value": 1.23456, "target": 2, "unit": "m", "at_most": false, "met": false}],
    "by_tip": [{"tip": "round", "force_n": 0.5}, {"tip": "flat", "force_n": 0.25}],
    "samples": [1, 2, 3]})");
  ASSERT_EQ(finished.code, 0) << finished.output;
  const std::string page = text_of(folder / "pages/reach.md");
  for (const char* part : {"# Results of `teletact-bench reach`", "- date: 2026-11-21", "- version: 0.1.0",
                           "| reach | 1.235 m | >= 2 m | **not met** |", "- clients: 4", "## by tip",
                           "| force n | tip |", "| 0.25 | flat |"})
    EXPECT_NE(page.find(part), std::string::npos) << part << "\n" << page;
  EXPECT_EQ(page.find("samples"), std::string::npos) << "raw figures stay in the JSON";
  EXPECT_EQ(page.find("quick"), std::string::npos);
}

TEST(Results, AQuickRunSaysSo) {
  const test::TemporaryFolder folder;
  ASSERT_EQ(report(folder, R"({"suite": "reach", "quick": true, "machine": {}, "targets": []})").code, 0);
  EXPECT_NE(text_of(folder / "pages/reach.md").find("not to quote"), std::string::npos);
}

TEST(Results, WhatIsNoResultIsRefusedByName) {
  const test::TemporaryFolder folder;
  for (const char* json :
       {"no json", "[]", R"({"suite": "reach"})", R"({"suite": 3, "machine": {}, "targets": []})"}) {
    const auto finished = report(folder, json);
    EXPECT_EQ(finished.code, 1) << json;
    EXPECT_NE(finished.output.find("result.json: not the --json of a suite"), std::string::npos)
        << finished.output;
  }
}

}  // namespace
}  // namespace teletact
