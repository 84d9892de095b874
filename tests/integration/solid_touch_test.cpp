// A stack of plane maps becomes a scene, and a finger goes in circles on it.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "client/files/metaimage.h"
#include "tests/integration/process.h"

namespace teletact {
namespace {

class SolidTouch : public testing::Test {
 protected:
  std::string address() const { return "unix:" + (folder / "s"); }
  std::string volume(const std::string& name, double origin_x_m, float pa = 1e4F) const {
    const std::vector<std::size_t> size{24, 10, 12};
    client::write_metaimage(
        folder / name, client::MetaImage::of<float>(size, {0.002, 0.002, 0.002}, {origin_x_m, 0.001, -0.011},
                                                    std::vector<float>(24 * 10 * 12, pa)));
    return folder / name;
  }
  test::Outcome slices(const std::vector<std::string>& more) const {
    std::vector<std::string> words{test::client_binary(), "slices", "--service", address(), "--scene", "a"};
    words.insert(words.end(), more.begin(), more.end());
    return test::run(words, folder / "slices.log");
  }
  // Until it has been felt once: kernels are compiled by then.
  void feel_once() const {
    test::Process touch({test::client_binary(), "touch", "--service", address(), "--scene", "a",
                         "--indentation-m", "0.001", "--tactile"},
                        folder / "first.log");
    ASSERT_TRUE(touch.says("beyond homogeneous", 300)) << touch.output();
    touch.kill(SIGINT);
    EXPECT_EQ(touch.wait(30), 0) << touch.output();
  }
  // A finger in circles, recorded with its tactile images.
  test::Outcome circles(const std::vector<std::string>& more) const {
    std::vector<std::string> words{
        test::client_binary(),  "touch", "--service", address(), "--scene", "a", "--tactile", "--record",
        folder / "touch.record"};
    words.insert(words.end(), more.begin(), more.end());
    return test::run(words, folder / "touch.log");
  }
  test::TemporaryFolder folder;
};

TEST_F(SolidTouch, OfAVolumeThatIsPublishedSliceBySlice) {
  test::Process service({test::service_binary(), "serve", "--listen", address()}, folder / "service.log");
  ASSERT_TRUE(service.says("serving on", 300)) << service.output();
  const auto refused = [&](const std::vector<std::string>& more, const std::string& why) {
    const test::Outcome outcome = slices(more);
    EXPECT_EQ(outcome.code, 1);
    EXPECT_NE(outcome.output.find(why), std::string::npos) << outcome.output;
  };
  refused({"--volume", volume("beside.mha", 0)}, "half of an ElementSpacing");
  refused({"--volume", volume("void.mha", 0.001, 0)}, "a modulus must be");
  client::write_metaimage(folder / "plane.mha", client::MetaImage::of<float>({2, 2}, {1, 1}, {0.5, 0.5},
                                                                             std::vector<float>(4, 1e4F)));
  refused({"--volume", folder / "plane.mha"}, "NDims = 3");
  refused({"--volume", folder / "none.mha"}, "none.mha");

  const test::Outcome made = slices({"--volume", volume("v.mha", 0.001), "--poisson-ratio", "0.45"});
  ASSERT_EQ(made.code, 0) << made.output;
  EXPECT_NE(made.output.find("slice 12 of 12 at z 11.0 mm can be touched: version 12"), std::string::npos)
      << made.output;
  refused({"--volume", folder / "v.mha"}, "ALREADY_EXISTS");

  feel_once();
  const test::Outcome touch =
      circles({"--indentation-m", "0.001", "--speed-m-s", "0.02", "--circle-radius-m", "0.003", "--begin-m",
               "0.014", "--end-m", "0.034", "--duration-s", "4", "--json", folder / "touch.json"});
  ASSERT_EQ(touch.code, 0) << touch.output;
  const nlohmann::json summary = nlohmann::json::parse(std::ifstream(folder / "touch.json"));
  EXPECT_EQ(summary["link"]["not_covered"], 0);
  EXPECT_GT(summary["largest_force_n"], 0.02);
  EXPECT_GT(summary["link"]["tactile_images"], 0);
}

// The demo of solids in short, with its report; and what that says of another patient.
TEST_F(SolidTouch, OfTheSimulatedPatientIsHeldAgainstItsOwnTissue) {
  test::Process service({test::service_binary(), "serve", "--listen", address()}, folder / "service.log");
  ASSERT_TRUE(service.says("serving on", 300)) << service.output();
  const test::Outcome made = slices({"--seed", "7"});
  ASSERT_EQ(made.code, 0) << made.output;
  feel_once();
  const test::Outcome touch = circles({"--indentation-m", "0.002", "--speed-m-s", "0.01", "--circle-radius-m",
                                       "0.004", "--begin-m", "0.03", "--end-m", "0.08", "--duration-s", "5"});
  ASSERT_EQ(touch.code, 0) << touch.output;
  const auto felt = [&](const std::string& seed, nlohmann::json& summary) {
    const test::Outcome outcome = test::run(
        {test::required_environment("TELETACT_BINARY_DIR") + "/bench/teletact-bench", "solid-felt",
         "--touch-record", folder / "touch.record", "--seed", seed, "--poses", "4", "--out", folder / seed},
        folder / "felt.log", {}, 300);
    std::ifstream file(folder / (seed + "/summary.json"));
    summary = nlohmann::json::parse(file, nullptr, false);
    if (!summary.is_object()) throw std::runtime_error(outcome.output);
    return outcome;
  };
  nlohmann::json own, others;
  const test::Outcome met = felt("7", own), missed = felt("8", others);
  EXPECT_LT(own["force_error"]["median"], 0.02) << met.output;
  EXPECT_EQ(own["force_error"]["samples"], 4) << met.output;
  EXPECT_LT(own["force_error"]["median"], own["force_error_with_nodes"]["median"]) << met.output;
  EXPECT_GT(own["plane_error"]["median"], 0.02) << met.output;
  EXPECT_LT(std::abs(own["truths_nodes"]["median"].get<double>()), 0.005) << met.output;
  EXPECT_LT(std::abs(own["truths_nodes"]["min"].get<double>()), 0.01) << met.output;
  EXPECT_EQ(own["stalls"]["count"], 0) << met.output;
  for (const char* file : {"force.png", "tactile.png", "latency.png"})
    EXPECT_TRUE(std::filesystem::exists(folder / ("7/" + std::string(file)))) << file;
  EXPECT_EQ(missed.code, 2) << missed.output;
  EXPECT_GT(others["force_error"]["median"], 0.02) << missed.output;
  EXPECT_NE(missed.output.find("NOT MET       force_error median"), std::string::npos) << missed.output;
}

}  // namespace
}  // namespace teletact
