// The suite of one device, as a process on small sizes: what it writes, goes on with and ends.
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bench/basics/gpu_model.h"
#include "tests/integration/process.h"

namespace teletact {
namespace {

class DeviceSuite : public testing::Test {
 protected:
  auto ran(const std::vector<std::string>& more, const test::Environment& environment = {}) {
    std::vector<std::string> command{test::required_environment("TELETACT_BINARY_DIR") +
                                     "/bench/teletact-bench"};
    command.insert(command.end(), more.begin(), more.end());
    constexpr double kMostS = 600;
    return test::run(command, folder_ / "log", environment, kMostS);
  }
  auto measured(std::vector<std::string> more, const test::Environment& environment = {}) {
    more.insert(more.begin(), {"device", "--quick", "--out", folder_ / "out"});
    return ran(more, environment);
  }
  std::string text(const std::string& name) const {
    std::ifstream file(folder_ / name);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  nlohmann::json written(const std::string& name) const {
    return nlohmann::json::parse(text("out/" + name), nullptr, false);
  }
  const test::TemporaryFolder folder_;
};

TEST_F(DeviceSuite, PartsAreKeptAndGoneOnWith) {
  const auto first = measured({"--only", "limits", "solids"});
  ASSERT_EQ(first.code, 0) << first.output;
  const auto limits = written("limits.json"), solids = written("solids.json");
  EXPECT_EQ(limits.at("ended"), "complete");
  for (const auto& [name, value] : limits.at("limits").at(0).items()) EXPECT_GT(value, 0) << name;
  const auto& stages = solids.at("stages");
  for (const auto& stage : stages) {
    EXPECT_GT(stage.at("launches"), 0) << stage;
  }
  const auto& gpu = stages.back();  // a processor's own is before it
  EXPECT_LE(gpu.at("launches"), 8) << gpu;
  EXPECT_EQ(gpu.at("waits"), 0) << gpu;
  EXPECT_GT(gpu.at("a_gpu_modelled_ms"), 8 * 1e3 * bench::GpuModel{}.launch_s) << gpu;
  const auto again = measured({"--only", "limits", "solids"});
  EXPECT_EQ(again.code, 1);
  EXPECT_NE(again.output.find("--resume"), std::string::npos) << again.output;
  const auto other = measured({"--resume", "--as-gpu", "--only", "references"});
  EXPECT_EQ(other.code, 1);
  EXPECT_NE(other.output.find("another device, build or kind of run"), std::string::npos) << other.output;
  const auto resumed = measured({"--resume", "--only", "limits", "references"});
  EXPECT_EQ(resumed.code, 0) << resumed.output;
  EXPECT_EQ(written("limits.json"), limits) << "measured anew";
  const auto suite = written("device.json"), all = suite.at("all");
  EXPECT_EQ(all.at("solids_stages"), stages);
  EXPECT_EQ(suite.at("stages").back().at("a_gpus_chain"), gpu.at("longest_chain"));
  ASSERT_GE(all.at("references").size(), 5);
  for (const auto& row : all.at("references")) EXPECT_TRUE(row.at("met")) << row;
  nlohmann::json of_another = limits;
  of_another["of"]["built"] = "1970-01-01 00:00:00";
  std::ofstream(folder_ / "out/limits.json") << of_another;
  const auto mixed = measured({"--resume", "--only", "limits", "references"});
  EXPECT_EQ(mixed.code, 1) << "nothing was left to run";
  EXPECT_NE(mixed.output.find("another device, build"), std::string::npos) << mixed.output;
  const auto page = ran({"report", folder_ / "out/device.json", "--out", folder_ / "pages"});
  ASSERT_EQ(page.code, 0) << page.output;
  EXPECT_NE(text("pages/device.md").find(suite.at("device").at("name")), std::string::npos);
}

// As a GPU, at true sizes: small ones hide what grows with them. A window's sweeps go from column to column
// of nodes, one behind the other.
TEST_F(DeviceSuite, ChainsAreShortAtTrueSizes) {
  constexpr int kMost = 1024, kOfAWindow = 4200;
  const auto run = ran({"device", "--out", folder_ / "out", "--only", "displacement", "solids", "planes",
                        "--part-limit-s", "500"});
  ASSERT_EQ(run.code, 0) << run.output;
  int windows = 0, others = 0;
  for (const char* part : {"displacement", "solids", "planes"}) {
    const nlohmann::json of_part = written(std::string(part) + ".json");
    ASSERT_EQ(of_part.at("ended"), "complete") << run.output;
    for (const auto& stage : of_part.at("stages")) {
      if (!stage.at("a_gpu_modelled_ms").is_number()) continue;
      const bool window = stage.at("stage").get<std::string>().find("32 loads") != std::string::npos;
      EXPECT_LE(stage.at("longest_chain"), window ? kOfAWindow : kMost) << stage;
      ++(window ? windows : others);
    }
  }
  EXPECT_EQ(windows, 1);
  EXPECT_EQ(others, 7);
}

TEST_F(DeviceSuite, APartIsEndedAtItsLimitAndSaysSo) {
  const auto run = measured({"--only", "solids", "--part-limit-s", "0.001"});
  EXPECT_EQ(run.code, 0) << run.output;
  EXPECT_EQ(written("solids.json").at("ended"), "stopped by its limit of 0.001 s");
  EXPECT_NE(run.output.find("stopped by its limit"), std::string::npos) << run.output;
  const auto none = measured({"--only", "solids", "--device", "none of these", "--force"});
  EXPECT_EQ(none.code, 1);
  EXPECT_NE(none.output.find("no OpenCL device matches"), std::string::npos) << none.output;
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)  // whose library must come first
TEST_F(DeviceSuite, ASlowOpenClIsSlowToCall) {
  const std::string slow =
      test::required_environment("TELETACT_BINARY_DIR") + "/bench/libteletact_slow_opencl.so";
  const auto run = measured({"--only", "limits"}, {{"LD_PRELOAD", slow}});
  ASSERT_EQ(run.code, 0) << run.output;
  const auto limits = written("limits.json").at("limits").at(0);
  EXPECT_GE(limits.at("launch_s"), bench::GpuModel{}.launch_s);
  EXPECT_GE(limits.at("wait_s").get<double>() + limits.at("launch_s").get<double>(),
            bench::GpuModel{}.launch_s + bench::GpuModel{}.wait_s);
}
#endif

// Iterations that an H100 was timed at: 18 launches, a wait, a serial sum of all nodes.
TEST(GpuModel, IsThatOfTheGpuOnRecord) {
  const bench::GpuModel model;
  const auto iteration_s = [&](double nodes) { return model.seconds(18, 1, nodes, 160 * nodes, 0); };
  EXPECT_GE(iteration_s(70e3), 0.7e-3);
  EXPECT_LE(iteration_s(70e3), 1.3e-3);
  EXPECT_GE(iteration_s(336e3), 3e-3);
  EXPECT_LE(iteration_s(336e3), 5e-3);
}

}  // namespace
}  // namespace teletact
