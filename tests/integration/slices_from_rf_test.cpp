// A volume from slices: a probe is pressed into solid tissue at two places, and what its RF says is touched.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "client/files/metaimage.h"
#include "tests/integration/process.h"

namespace teletact {
namespace {

// A lump in the second slice's plane alone; little tissue under a small probe.
constexpr const char* kTissue =
    "seed = 5\n"
    "[tissue]\nwidth_m = 0.050\ndepth_m = 0.025\n"
    "[solid]\nelevational_width_m = 0.040\n"
    "[probe]\nwidth_m = 0.030\nlines = 128\nelevation_m = 0.008\ncompression_m = 0.0006\n"
    "[[inclusion]]\nshape = \"sphere\"\nposition_m = [0.026, 0.010, 0.006]\ndiameter_m = 0.008\ncontrast = "
    "4\n";

TEST(SlicesFromRf, MakeASolidThatGrowsAndIsFelt) {
  test::TemporaryFolder folder;
  const std::string address = "unix:" + (folder / "s"), client = test::client_binary();
  std::ofstream(folder / "t.toml") << kTissue;
  test::Process service({test::service_binary(), "serve", "--listen", address}, folder / "service.log");
  ASSERT_TRUE(service.says("serving on", 300)) << service.output();
  const std::vector<std::string> acquire{client,
                                         "acquire",
                                         "--service",
                                         address,
                                         "--scene",
                                         "a",
                                         "--tissue",
                                         folder / "t.toml",
                                         "--slices",
                                         "2",
                                         "--slice-pitch-m",
                                         "0.010",
                                         "--first-slice-z-m",
                                         "-0.004",
                                         "--passes-prepared",
                                         "1",
                                         "--modulus-time-limit-s",
                                         "30",
                                         "--save-modulus",
                                         folder / "m.mha",
                                         "--save-log-std",
                                         folder / "s.mha"};
  const test::Outcome acquired = test::run(acquire, folder / "acquire.log", {}, 300);
  ASSERT_EQ(acquired.code, 0) << acquired.output;
  EXPECT_NE(acquired.output.find("slice 1 of 2 can be touched: version 1"), std::string::npos)
      << acquired.output;
  EXPECT_NE(acquired.output.find("2 slices published"), std::string::npos) << acquired.output;

  const client::MetaImage image = client::read_metaimage(folder / "m.mha");
  ASSERT_EQ(image.size, (std::vector<std::size_t>{15, 25, 2}));
  const std::vector<float> pa = image.as<float>(),
                           log_std = client::read_metaimage(folder / "s.mha").as<float>();
  // In the lump, x 16 mm from the image's left border, and as deep beside it.
  const auto at = [&](std::size_t i, std::size_t j, std::size_t k) { return i + 15 * (j + 25 * k); };
  std::printf("[ found ] %.1f and %.1f kPa in the lump's place of either slice, %.1f kPa beside it\n",
              pa[at(7, 10, 0)] / 1e3, pa[at(7, 10, 1)] / 1e3, pa[at(2, 10, 1)] / 1e3);
  EXPECT_GT(pa[at(7, 10, 1)], 1.8 * pa[at(7, 10, 0)]);
  EXPECT_NEAR(pa[at(7, 10, 0)] / 1e4, 1, 0.25);
  EXPECT_GT(log_std[at(7, 0, 1)], 0.5) << "the topmost millimetres determine nothing";

  const test::Outcome list = test::run({client, "scenes", "--service", address}, folder / "scenes.log");
  EXPECT_NE(list.output.find("a  solid, 0.030 x 0.025 m"), std::string::npos) << list.output;
  const test::Outcome again = test::run(acquire, folder / "again.log");
  EXPECT_EQ(again.code, 1);
  EXPECT_NE(again.output.find("it exists"), std::string::npos) << again.output;

  const test::Outcome touch = test::run({client,
                                         "touch",
                                         "--service",
                                         address,
                                         "--scene",
                                         "a",
                                         "--along",
                                         "z",
                                         "--begin-m",
                                         "-0.002",
                                         "--end-m",
                                         "0.004",
                                         "--indentation-m",
                                         "0.001",
                                         "--speed-m-s",
                                         "0.01",
                                         "--passes",
                                         "1",
                                         "--json",
                                         folder / "touch.json"},
                                        folder / "touch.log", {}, 120);
  ASSERT_EQ(touch.code, 0) << touch.output;
  const nlohmann::json summary = nlohmann::json::parse(std::ifstream(folder / "touch.json"));
  EXPECT_EQ(summary["link"]["not_covered"], 0);
  EXPECT_GT(summary["largest_force_n"], 0.02);
  // What it saved makes the same scene.
  const test::Outcome given = test::run({client, "slices", "--service", address, "--scene", "b", "--volume",
                                         folder / "m.mha", "--log-std", folder / "s.mha"},
                                        folder / "given.log");
  EXPECT_EQ(given.code, 0) << given.output;
}

}  // namespace
}  // namespace teletact
