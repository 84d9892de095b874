// What `patient` writes of a solid: the pair, its truth, and every option that made it.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "client/files/metaimage.h"
#include "client/patient/tissue.h"
#include "tests/integration/process.h"

namespace teletact {
namespace {

TEST(PatientFiles, OfASolidHoldItsTruth) {
  const test::TemporaryFolder folder;
  client::Tissue t = client::unlike_model(5, 4);
  t.width_m = .07, t.depth_m = .03, t.inclusions[0].x_m = .035, t.ultrasound.depth_m = .025;
  t.solid->elevational_width_m = .02, t.solid->texture = 0;
  client::write_tissue(folder / "tissue.toml", t);
  const auto run = test::run(
      {test::client_binary(), "patient", "--tissue", folder / "tissue.toml", "--out", folder / "out"},
      folder / "log");
  ASSERT_EQ(run.code, 0) << run.output;
  std::ifstream file(folder / "out/truth.json");
  const auto truth = nlohmann::json::parse(file);
  EXPECT_EQ(truth.at("solid").at("friction"), "inf");
  EXPECT_EQ(truth.at("solid").at("uneven"), t.solid->uneven);
  EXPECT_EQ(truth.at("elevation_beam_m"), t.ultrasound.elevation_beam_m);
  EXPECT_EQ(truth.at("probe_elevation_m"), t.probe.elevation_m);
  EXPECT_EQ(truth.at("inclusions").at(0).at("contrast"), 4);
  ASSERT_EQ(truth.at("windows").size(), 1) << "the middle of it";
  const auto& window = truth.at("windows").at(0);
  EXPECT_NEAR(window.at("window_x_m"), .005, 1e-9);
  EXPECT_GT(window.at("true_force_n"), 0);
  EXPECT_NEAR(window.at("tilt"), t.solid->uneven * t.probe.compression_m / .03, 1e-12);
  const auto modulus = client::read_metaimage(folder / "out/window0_truth_modulus.mha");
  EXPECT_EQ(modulus.size, (std::vector<std::size_t>{101, 241})) << "what is imaged of the depth";
  const auto moved = client::read_metaimage(folder / "out/window0_truth_displacement.mha").as<double>();
  for (const std::size_t column : {std::size_t{0}, std::size_t{120}, std::size_t{240}})
    EXPECT_NEAR(moved[2 * 101 * column], 0, 1e-9) << "the face, in its own frame";
  EXPECT_LT(moved[2 * (101 * 120 + 60)], -1e-4);
}

}  // namespace
}  // namespace teletact
