// The solid suite for seconds, as a process: what it promises of numbers holds on any machine.
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/integration/process.h"

namespace teletact {
namespace {

TEST(SolidSuite, WhatIsNoMatterOfTimeHolds) {
  constexpr double kSuiteS = 600;
  const test::TemporaryFolder folder;
  const auto measured = [&](const std::string& part) {
    const std::string json_file = folder / (part + ".json"), pictures = folder / part;
    const auto run = test::run({test::required_environment("TELETACT_BINARY_DIR") + "/bench/teletact-bench",
                                "solid", part, "--quick", "--json", json_file, "--out", pictures},
                               folder / (part + ".log"), {}, kSuiteS);
    EXPECT_EQ(run.code, 0) << run.output;
    std::ifstream file(json_file);
    const auto result = nlohmann::json::parse(file, nullptr, false);
    if (!result.is_object()) throw std::runtime_error(run.output);
    return result.at(part);
  };
  const auto bound = measured("bound");
  for (const char* of : {"energy", "force"}) {
    EXPECT_GT(bound.at(of).at("iterations"), 100) << of;
    EXPECT_EQ(bound.at(of).at("broken"), 0) << of;
  }
  EXPECT_TRUE(std::filesystem::exists(folder / "bound/solid_bound.png"));
  const auto plane = measured("plane").at("beside");
  EXPECT_GT(plane.front().at("difference"), 1e-5) << "two ways that are the same show nothing";
  EXPECT_LT(plane.back().at("difference"), 1e-10);
  const auto exact = measured("exact");
  EXPECT_EQ(exact.at("forces").size(), 3) << "rigid tips alone: the quick one";
  EXPECT_GT(exact.at("tangents").size(), 5);
}

}  // namespace
}  // namespace teletact
