#include "client/recordings/set_output.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "tests/files/temporary_folder.h"

namespace teletact::client {
namespace {

v1::Map map_of_value(const std::string& name, float value) {
  v1::Map map;
  map.set_name(name);
  for (int axis = 0; axis < 2; ++axis) {
    map.mutable_grid()->add_size(2);
    map.mutable_grid()->add_origin_m(0);
    map.mutable_grid()->add_spacing_m(0.001);
    map.mutable_values()->add_shape(2);
  }
  const std::vector<float> values(4, value);
  map.mutable_values()->set_dtype(v1::DATA_TYPE_FLOAT32);
  map.mutable_values()->set_data(values.data(), values.size() * sizeof(float));
  return map;
}

EstimatedPair estimated(double quality, const std::string& warning = "") {
  EstimatedPair pair;
  pair.outcome.maps = {map_of_value("youngs_modulus", 1e4F), map_of_value("youngs_modulus_log_std", 0.1F),
                       map_of_value("valid", 1)};
  pair.outcome.summary.set_quality(quality);
  pair.outcome.summary.set_modulus_absolute(true);
  if (!warning.empty()) pair.outcome.summary.add_warnings(warning);
  return pair;
}

EstimatedPair refused() {
  EstimatedPair pair;
  pair.refusal = "could not be tracked";
  return pair;
}

TEST(JoinPlace, WarnsOfWhatIsInItAlone) {
  const EstimatedPlace place =
      join_place({}, {estimated(0.9, "tissue slid by 2 mm"), estimated(0.8, "tissue slid by 3 mm"),
                      estimated(0.1, "the correlation is 0.4"), refused()});
  ASSERT_EQ(place.joined.used, 2u);
  EXPECT_FALSE(place.left_out[2].empty());
  EXPECT_EQ(place.warnings, std::vector<std::string>{"2 of 2 pairs: tissue slid by 2 mm"});
}

TEST(WriteVolume, APlaneOfWhichNothingIsKnownIsLeftEmpty) {
  const TemporaryFolder folder;
  const auto written = write_volume(
      folder / "out",
      {join_place(0.0, {estimated(0.9)}), join_place(0.005, {refused()}), join_place(0.01, {estimated(0.9)})},
      {});
  EXPECT_NE(std::find(written.begin(), written.end(), "volume.vti"), written.end());
  const std::string vti = content_of(folder / "out/volume.vti");
  EXPECT_NE(vti.find("WholeExtent=\"0 1 0 1 0 2\""), std::string::npos) << vti.substr(0, 400);
  const auto json = nlohmann::json::parse(content_of(folder / "out/estimate.json"));
  ASSERT_EQ(json.at("slices").size(), 3u);
  EXPECT_EQ(json.at("slices").at(1).at("used"), 0);
  EXPECT_FALSE(json.at("slices").at(1).contains("folder"));
  EXPECT_EQ(json.at("slices").at(2).at("folder"), "slice-3");
}

TEST(WriteVolume, OfNothingIsRefused) {
  const TemporaryFolder folder;
  EXPECT_THROW(write_volume(folder / "out", {join_place(0.0, {refused()})}, {}), std::invalid_argument);
}

}  // namespace
}  // namespace teletact::client
