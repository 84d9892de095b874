// Pages of results are made of what the benches wrote, and of nothing else.
#include <fmt/format.h>
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

// Of result.json, result_1.json ...
auto report(const test::TemporaryFolder& folder, const std::vector<std::string>& results) {
  std::vector<std::string> command{
      test::required_environment("TELETACT_BINARY_DIR") + "/bench/teletact-bench", "report", "--out",
      folder / "pages"};
  for (std::size_t k = 0; k < results.size(); ++k) {
    command.push_back(folder / (k == 0 ? "result.json" : "result_" + std::to_string(k) + ".json"));
    std::ofstream(command.back()) << results[k];
  }
  return test::run(command, folder / "report.log", {}, kReportS);
}
auto report(const test::TemporaryFolder& folder, const std::string& json) {
  return report(folder, std::vector{json});
}

TEST(Results, APageHoldsTheMachineThePromisesAndTheTables) {
  const test::TemporaryFolder folder;
  const auto finished = report(folder, R"({"suite": "reach", "quick": false, "clients": 4,
    "machine": {"date": "2026-11-21", "version": "0.1.0", "cores": 2},
    "targets": [{"name": "reach", "value": 1.23456, "target": 2, "unit": "m", "at_most": false, "met": false}],
    "by_tip": [{"tip": "round", "force_n": 0.5}, {"tip": "flat", "force_n": 0.25, "stuck": true}],
    "samples": [1, 2, 3], "touch": {"idle": {"p50_s": 0.5, "p99_s": 2, "samples": [4]}}})");
  ASSERT_EQ(finished.code, 0) << finished.output;
  const std::string page = text_of(folder / "pages/reach.md");
  for (const char* part :
       {"# Results of `teletact-bench reach`", "report`: 2 cores, teletact 0.1.0, 2026-11-21.",
        "| reach | **1.235 m, not met** | >= 2 m |\n", "- clients: 4", "- touch, idle: p50 s 0.5, p99 s 2",
        "## by tip", "| force n | tip | stuck |", "| 0.25 | flat | yes |", "| 0.5 | round | - |"})
    EXPECT_NE(page.find(part), std::string::npos) << part << "\n" << page;
  EXPECT_EQ(page.find("samples"), std::string::npos) << "raw figures stay in the JSON";
  EXPECT_EQ(page.find("quick"), std::string::npos);
}

TEST(Results, PromisesOfOneKindThatAreMetShareARow) {
  const test::TemporaryFolder folder;
  const auto promise = [](const char* name, double value, double target) {
    return fmt::format(
        R"({{"name": "{}", "value": {}, "target": {}, "unit": "s", "at_most": true, "met": {}}})", name,
        value, target, value <= target);
  };
  const auto finished = report(
      folder, fmt::format(R"({{"suite": "reach", "machine": {{}}, "targets": [{}, {}, {}, {}, {}, {}]}})",
                          promise("link_0_ms_law_faded", 0.5, 1), promise("link_50_ms_law_faded", 0.75, 1),
                          promise("link_50_ms_law_lost", 0.5, 1), promise("link_90_ms_law_faded", 0.25, 1),
                          promise("link_99_ms_law_faded", 3, 1), promise("link_70_ms_law_faded", 0.5, 2)));
  ASSERT_EQ(finished.code, 0) << finished.output;
  const std::string page = text_of(folder / "pages/reach.md");
  EXPECT_NE(page.find("| link_..._ms_law_faded (worst of 3) | 0.75 s | <= 1 s |\n"
                      "| link_50_ms_law_lost | 0.5 s | <= 1 s |\n"
                      "| link_99_ms_law_faded | **3 s, not met** | <= 1 s |\n"
                      "| link_70_ms_law_faded | 0.5 s | <= 2 s |\n"),
            std::string::npos)
      << page;
}

TEST(Results, NamesComeFirstAndWhatAllRowsShareIsSaidOnce) {
  const test::TemporaryFolder folder;
  const auto finished = report(folder, R"({"suite": "reach", "machine": {}, "targets": [], "by_tip": [
    {"name": "round", "cases": 60, "force_n": 0.5, "seconds": 7}, {"name": "flat", "cases": 60, "force_n": 0.25},
    {"name": "wide", "cases": 60, "force_n": 1}]})");
  ASSERT_EQ(finished.code, 0) << finished.output;
  const std::string page = text_of(folder / "pages/reach.md");
  EXPECT_NE(
      page.find("## by tip\n\nIn each row: cases 60.\n\n| name | force n |\n|---|---|\n| round | 0.5 |\n"),
      std::string::npos)
      << page;
  EXPECT_EQ(page.find("seconds"), std::string::npos) << page;
}

TEST(Results, AQuickRunSaysSo) {
  const test::TemporaryFolder folder;
  ASSERT_EQ(report(folder, R"({"suite": "reach", "quick": true, "machine": {}, "targets": []})").code, 0);
  EXPECT_NE(text_of(folder / "pages/reach.md").find("not to quote"), std::string::npos);
}

TEST(Results, ABarInATextStaysInItsCell) {
  const test::TemporaryFolder folder;
  const auto finished = report(folder, R"({"suite": "reach", "machine": {},
    "targets": [{"name": "a | b", "value": 1, "target": 2, "unit": "m", "at_most": true, "met": true}],
    "by_tip": [{"tip": "round | flat", "force_n": 0.5}]})");
  ASSERT_EQ(finished.code, 0) << finished.output;
  const std::string page = text_of(folder / "pages/reach.md");
  for (const char* part : {R"(| a \| b | 1 m |)", R"(| 0.5 | round \| flat |)"})
    EXPECT_NE(page.find(part), std::string::npos) << part << "\n" << page;
}

TEST(Results, TwoResultsOfOneSuiteDoNotOverwriteEachOther) {
  const test::TemporaryFolder folder;
  const std::string reach = R"({"suite": "reach", "machine": {}, "targets": []})";
  const auto finished = report(folder, {reach, reach});
  EXPECT_EQ(finished.code, 1);
  for (const char* part : {"result.json", "result_1.json", "reach"})
    EXPECT_NE(finished.output.find(part), std::string::npos) << finished.output;
  EXPECT_FALSE(std::filesystem::exists(folder / "pages/reach.md"));
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
