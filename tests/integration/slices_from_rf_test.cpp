// A volume from slices: a probe is pressed into solid tissue at two places, and what its RF says is touched.
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "client/files/metaimage.h"
#include "tests/integration/process.h"

namespace teletact {
namespace {

// A lump in the second slice's plane alone; little tissue under a small probe.
constexpr const char* kSlicedTissue =
    "seed = 5\n"
    "[tissue]\nwidth_m = 0.050\ndepth_m = 0.025\n"
    "[solid]\nelevational_width_m = 0.040\n"
    "[probe]\nwidth_m = 0.030\nlines = 128\nelevation_m = 0.008\ncompression_m = 0.0006\n"
    "[[inclusion]]\nshape = \"sphere\"\nposition_m = [0.026, 0.010, 0.006]\ndiameter_m = 0.008\ncontrast = "
    "4\n";

TEST(SlicesFromRf, MakeASolidThatGrowsAndIsFelt) {
  test::TemporaryFolder folder;
  const std::string address = "unix:" + (folder / "s"), client = test::client_binary();
  std::ofstream(folder / "t.toml") << kSlicedTissue;
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
                                         "30"};
  std::vector<std::string> kept = acquire;
  kept.insert(kept.end(), {"--save-modulus", folder / "m.mha", "--save-log-std", folder / "s.mha", "--record",
                           folder / "acquire.record"});
  const test::Outcome acquired = test::run(kept, folder / "acquire.log", {}, 300);
  ASSERT_EQ(acquired.code, 0) << acquired.output;
  EXPECT_NE(acquired.output.find("slice 1 of 2 can be touched: version 1"), std::string::npos)
      << acquired.output;
  EXPECT_NE(acquired.output.find("2 slices published"), std::string::npos) << acquired.output;

  EXPECT_NE(acquired.output.find("slice 1 of 2 is corrected by its neighbours: version 3"), std::string::npos)
      << acquired.output;
  std::ifstream record(folder / "acquire.record", std::ios::binary);
  const std::string recorded{std::istreambuf_iterator<char>(record), {}};
  for (const char* beside :
       {"known from -10.0 to -10.0 mm", "known from 10.0 to 10.0 mm", "agrees with other slices (1)"})
    EXPECT_NE(recorded.find(beside), std::string::npos) << beside;

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
  EXPECT_NE(list.output.find("tissue at z = "), std::string::npos) << list.output;
  const test::Outcome again = test::run(acquire, folder / "again.log");
  EXPECT_EQ(again.code, 1);
  EXPECT_NE(again.output.find("--scene a: it exists"), std::string::npos) << again.output;

  std::vector<std::string> touch{
      client,      "touch",  "--service", address, "--scene",         "a",     "--along",     "z",
      "--begin-m", "-0.002", "--end-m",   "0.004", "--indentation-m", "0.002", "--speed-m-s", "0.01",
      "--tactile"};
  test::Process first(touch, folder / "first.log");  // kernels are compiled by the time that it feels
  ASSERT_TRUE(first.says("beyond homogeneous", 300)) << first.output();
  first.kill(SIGINT);
  ASSERT_EQ(first.wait(30), 0) << first.output();
  touch.insert(touch.end(),
               {"--duration-s", "3", "--record", folder / "touch.record", "--json", folder / "touch.json"});
  const test::Outcome felt = test::run(touch, folder / "touch.log");
  ASSERT_EQ(felt.code, 0) << felt.output;
  const nlohmann::json summary = nlohmann::json::parse(std::ifstream(folder / "touch.json"));
  EXPECT_EQ(summary["link"]["not_covered"], 0);
  EXPECT_GT(summary["largest_force_n"], 0.02);
  const test::Outcome judged =
      test::run({test::required_environment("TELETACT_BINARY_DIR") + "/bench/teletact-felt", "--touch-record",
                 folder / "touch.record", "--tissue", folder / "t.toml", "--modulus", folder / "m.mha",
                 "--acquire-record", folder / "acquire.record", "--poses", "2", "--out", folder / "out"},
                folder / "felt.log", {}, 300);
  const nlohmann::json report =
      nlohmann::json::parse(std::ifstream(folder / "out/summary.json"), nullptr, false);
  ASSERT_TRUE(report.is_object()) << judged.output;
  EXPECT_LT(report["force_error"]["median"], 0.3) << judged.output;
  EXPECT_EQ(report["interval"]["stated"], 1.0) << judged.output;
  EXPECT_EQ(report["slices"]["published"], 2) << judged.output;
  EXPECT_EQ(report["slices"]["unseen_share"], 0.0) << judged.output;
  EXPECT_EQ(report["lumps"]["missed"], 0.0) << judged.output;
  EXPECT_EQ(report["lumps"]["invented"].size(), 0u) << judged.output;
  // What it saved makes the same scene.
  const test::Outcome given = test::run({client, "slices", "--service", address, "--scene", "b", "--volume",
                                         folder / "m.mha", "--log-std", folder / "s.mha"},
                                        folder / "given.log");
  EXPECT_EQ(given.code, 0) << given.output;
}

}  // namespace
}  // namespace teletact
