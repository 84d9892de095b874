// `estimate` with several pairs: what is joined, what is left out and why, and planes that become a volume.
// The frames are made by `patient`.
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "client/acquire/simulated_source.h"
#include "client/files/metaimage.h"
#include "client/patient/tissue.h"
#include "tests/integration/process.h"

namespace teletact {
namespace {

class RecordedSet : public ::testing::Test {
 protected:
  // Frames of one window, at rest and pressed twice as far: NAME_pre.mha, NAME_post.mha.
  void make_frames(const std::string& name, double compression_m, std::uint64_t seed) {
    client::Tissue tissue = client::random_tissue(3);
    tissue.seed = seed;
    tissue.width_m = 0.06, tissue.depth_m = 0.03;
    tissue.inclusions.resize(1);
    tissue.inclusions[0] = {0.03, 0.012, 0.01, 3};
    tissue.probe.width_m = 0.03, tissue.probe.lines = 96, tissue.probe.compression_m = compression_m;
    client::write_tissue(folder_ / (name + ".toml"), tissue);
    const auto run = test::run({test::client_binary(), "patient", "--tissue", folder_ / (name + ".toml"),
                                "--window-x-m", "0.015", "--out", folder_ / name},
                               folder_ / "log");
    ASSERT_EQ(run.code, 0) << run.output;
    std::filesystem::rename(folder_ / (name + "/window0_pre.mha"), folder_ / (name + "_pre.mha"));
    std::filesystem::rename(folder_ / (name + "/window0_post.mha"), folder_ / (name + "_post.mha"));
  }
  test::Outcome estimate(const std::vector<std::string>& more) {
    std::vector<std::string> command{test::client_binary(),
                                     "estimate",
                                     "--service",
                                     address_,
                                     "--center-frequency-hz",
                                     "7.3e6",
                                     "--sampling-frequency-hz",
                                     "40e6",
                                     "--frame",
                                     "PROBE",
                                     "--plane",
                                     "strain",
                                     "--modulus-method",
                                     "direct",
                                     "--tissue-width-m",
                                     "0.06",
                                     "--tissue-depth-m",
                                     "0.03",
                                     "--out",
                                     folder_ / "out"};
    command.insert(command.end(), more.begin(), more.end());
    return test::run(command, folder_ / "log");
  }
  nlohmann::json written() {
    std::ifstream file(folder_ / "out/estimate.json");
    return nlohmann::json::parse(file);
  }

  test::TemporaryFolder folder_;
  std::string address_ = "unix:" + (folder_ / "s");
};

TEST_F(RecordedSet, IsJoinedOrBecomesAVolume) {
  test::Process service({test::service_binary(), "serve", "--listen", address_}, folder_ / "service.log");
  make_frames("a", 3e-4, 1);
  make_frames("b", 4e-4, 2);
  const std::string a = folder_ / "a_pre.mha", b = folder_ / "b_pre.mha";
  // The third is of two unrelated frames.
  auto run = estimate({"--pre", a, b, a, "--post", folder_ / "a_post.mha", folder_ / "b_post.mha", b});
  ASSERT_EQ(run.code, 0) << run.output;
  EXPECT_NE(run.output.find("2 of 3 pairs used"), std::string::npos) << run.output;
  auto json = written();
  EXPECT_EQ(json.at("used"), 2);
  EXPECT_TRUE(json.at("pairs").at(1).at("used"));
  EXPECT_FALSE(json.at("pairs").at(2).at("used"));
  EXPECT_FALSE(json.at("pairs").at(2).at("left_out").get<std::string>().empty());
  EXPECT_GT(json.at("log_std").at("shared"), 0.5 * json.at("log_std").at("of_one_pair").get<double>());
  EXPECT_FALSE(json.at("modulus").at("absolute")) << "no force";
  EXPECT_NEAR(json.at("modulus").at("background").get<double>(), 1, 1e-3);
  EXPECT_GE(json.at("assumed").size(), 3u) << "one place, other first frames, relative levels";
  for (const char* file : {"modulus.vti", "modulus.png", "pair-1/estimate.json", "pair-2/strain.vti"})
    EXPECT_TRUE(std::filesystem::exists(folder_ / ("out/" + std::string(file)))) << file;

  // Two planes, one of them with a pair that cannot be used.
  run = estimate({"--pre", a, b, a, "--post", folder_ / "a_post.mha", folder_ / "b_post.mha", b, "--z-m",
                  "0.005", "0", "0"});
  ASSERT_EQ(run.code, 0) << run.output;
  json = written();
  ASSERT_EQ(json.at("slices").size(), 2u);
  EXPECT_EQ(json.at("slices").at(0).at("z_m"), 0);
  EXPECT_EQ(json.at("slices").at(0).at("used"), 1);
  std::ifstream file(folder_ / "out/volume.vti");
  const std::string vti(std::istreambuf_iterator<char>(file), {});
  EXPECT_NE(vti.find(" 0 1\" Origin="), std::string::npos) << "two planes: " << vti.substr(0, 400);
  EXPECT_NE(vti.find("youngs_modulus_log_std"), std::string::npos);

  run = estimate({"--pre", a, b, "--post", b, a});
  EXPECT_GT(run.code, 0);
  EXPECT_NE(run.output.find("none of the pairs could be used"), std::string::npos) << run.output;
}

}  // namespace
}  // namespace teletact
