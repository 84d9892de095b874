// The suites of solid tissue for seconds, as processes: what they promise of numbers holds on any machine.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "bench/basics/median.h"
#include "tests/integration/process.h"

namespace teletact {
namespace {

constexpr double kSuiteS = 1500;

auto ran(const std::vector<std::string>& arguments, const std::string& log) {
  std::vector<std::string> command{test::required_environment("TELETACT_BINARY_DIR") +
                                   "/bench/teletact-bench"};
  command.insert(command.end(), arguments.begin(), arguments.end());
  return test::run(command, log, {}, kSuiteS);
}

// `what`: a suite, and a part of it.
nlohmann::json measured(const test::TemporaryFolder& folder, std::vector<std::string> what) {
  const std::string name = what.back(), json_file = folder / (name + ".json");
  std::vector<std::string> arguments = what;
  arguments.insert(arguments.end(), {"--quick", "--json", json_file, "--out", folder / name});
  const auto run = ran(arguments, folder / (name + ".log"));
  EXPECT_EQ(run.code, 0) << run.output;
  std::ifstream file(json_file);
  const auto result = nlohmann::json::parse(file, nullptr, false);
  if (!result.is_object()) throw std::runtime_error(run.output);
  return what.size() > 1 ? result.at(name) : result;
}

TEST(SolidSuite, WhatIsNoMatterOfTimeHolds) {
  const test::TemporaryFolder folder;
  const auto bound = measured(folder, {"solid", "bound"});
  for (const char* of : {"energy", "force"}) {
    EXPECT_GT(bound.at(of).at("iterations"), 100) << of;
    EXPECT_EQ(bound.at(of).at("broken"), 0) << of;
  }
  EXPECT_TRUE(std::filesystem::exists(folder / "bound/solid_bound.png"));
  const auto plane = measured(folder, {"solid", "plane"}).at("beside");
  EXPECT_GT(plane.front().at("difference"), 1e-5) << "two ways that are the same show nothing";
  EXPECT_LT(plane.back().at("difference"), 1e-10);
  const auto exact = measured(folder, {"solid", "exact"});
  EXPECT_EQ(exact.at("forces").size(), 3) << "rigid tips alone: the quick one";
  EXPECT_GT(exact.at("tangents").size(), 5);
}

TEST(PlanSuite, EveryModelAnswersEveryPair) {
  const test::TemporaryFolder folder;
  const auto plan = measured(folder, {"plan"});
  EXPECT_EQ(plan.at("pairs").size(), 12);
  EXPECT_TRUE(plan.at("failures").empty());
  ASSERT_EQ(plan.at("cases").size(), 2);
  EXPECT_GT(plan.at("cases")[0].at("shares_error"), 0.1) << "a case that is hard for nobody";
  const auto& hard = plan.at("cases")[1];
  EXPECT_LE(hard.at("error"), hard.at("stated"));
  if (!hard.at("said").get<std::string>().starts_with("DEGRADED")) {
    EXPECT_LE(hard.at("stated"), 0.2) << "corrected, or said not to be";
  }
  EXPECT_EQ(plan.at("learning").size(), 2);
  const auto of_all = [&](const std::string& model) {
    for (const auto& s : plan.at("summaries"))
      if (s.at("kind") == "all" && s.at("model") == model) return s;
    throw std::runtime_error("no model " + model);
  };
  EXPECT_LT(of_all("M1").at("p95"), of_all("M2").at("p95")) << "shares of the force say nothing";
  EXPECT_LT(of_all("M3").at("p95"), of_all("M3 nodes").at("p95"));
  EXPECT_LT(of_all("M1").at("ms"), of_all("M3").at("ms"));
  EXPECT_LT(of_all("M3 8").at("beside_most"), 0.005) << "off the converged contact on its own nodes";
  EXPECT_TRUE(std::filesystem::exists(folder / "plan/plan.png"));
}

class RealTissueSuite : public testing::Test {
 protected:
  // One seed of each row, each row once.
  nlohmann::json quick(const std::string& name, const std::vector<std::string>& more) {
    std::vector<std::string> arguments{"real-tissue",  "--quick",           "--json",
                                       folder_ / name, "--truth-spacing-m", "0.002"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const auto run = ran(arguments, folder_ / (name + ".log"));
    EXPECT_EQ(run.code, 0) << run.output;
    std::ifstream file(folder_ / name);
    return nlohmann::json::parse(file).at("rows");
  }
  const test::TemporaryFolder folder_;
};

// Whatever the row changes: right within a tenth and a half, or inside what is stated.
TEST_F(RealTissueSuite, EveryRowIsRightOrSaysHowFarItMayBeOff) {
  constexpr double kNear = 0.15, kMinHeldShare = 0.95;
  const auto rows = quick("rows.json", {"--promised"});
  ASSERT_GE(rows.size(), 24);
  std::vector<double> backgrounds;
  double held = 0, windows = 0;
  for (const auto& row : rows) {
    const auto near = [&](const char* what) { return std::abs(row.at(what).get<double>() - 1) <= kNear; };
    EXPECT_EQ(row.at("refused"), 0) << row;
    EXPECT_TRUE(near("background") || row.at("background_held") == 1) << row;
    if (row.at("name").get<std::string>().find("capsule") != std::string::npos) {
      EXPECT_EQ(row.at("skin_held"), 1) << row;
    }
    backgrounds.push_back(row.at("background"));
    held += row.at("background_held").get<double>(), windows += 1;
    if (row.at("contrast_of_lump") == 1) continue;
    EXPECT_TRUE(near("contrast") || row.at("lump_held") == 1) << row;
    held += row.at("lump_held").get<double>(), windows += 1;
  }
  EXPECT_GE(held, kMinHeldShare * windows);
  EXPECT_NEAR(bench::median_of(backgrounds), 1, 0.1);
}

TEST_F(RealTissueSuite, PlaneStrainIsNotEnoughAndRunsAreJoined) {
  const auto rows = quick("first.json", {"--only", "no lump", "--keep", folder_ / "kept"});
  for (const char* name : {"pre.mha", "post.mha", "truth.json"})
    EXPECT_TRUE(std::filesystem::exists(folder_ / std::string("kept/no_lump_contrast_1_seed_1/") + name))
        << name;
  double shown = 0;
  for (const auto& row : rows) {
    if (row.at("name") != "no lump" || row.at("estimator") != "plane strain") continue;
    EXPECT_GT(row.at("ramp"), 2) << "else this solid is not unlike the estimator";
    EXPECT_GT(row.at("background"), 1.3);
    ++shown;
  }
  EXPECT_EQ(shown, 1);
  // Runs of some seeds each are joined, and none is counted twice.
  const std::string first = folder_ / "first.json";
  EXPECT_EQ(quick("joined.json", {"--only", "no lump", "--seeds", "0", "--windows-of", first}), rows);
  const auto twice = ran(
      {"real-tissue", "--quick", "--seeds", "0", "--truth-spacing-m", "0.002", "--windows-of", first, first},
      folder_ / "twice.log");
  EXPECT_EQ(twice.code, 1);
  EXPECT_NE(twice.output.find("seed 1 of \"no lump\" is in another of the files"), std::string::npos)
      << twice.output;
}

}  // namespace
}  // namespace teletact
