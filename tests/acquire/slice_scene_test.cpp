// What an estimate's maps make of a slice, and slices of a volume.
#include "client/acquire/slice_scene.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

namespace teletact::client {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

// Nodes 1 mm apart from half of a millimetre on.
v1::Map map_of(const std::string& name, std::uint32_t columns, std::uint32_t rows,
               const std::vector<float>& values) {
  v1::Map map;
  map.set_name(name);
  for (const std::uint32_t n : {columns, rows}) {
    map.mutable_grid()->add_size(n);
    map.mutable_grid()->add_origin_m(0.0005);
    map.mutable_grid()->add_spacing_m(0.001);
  }
  map.mutable_values()->set_dtype(v1::DATA_TYPE_FLOAT32);
  map.mutable_values()->set_data(values.data(), values.size() * sizeof(float));
  return map;
}

SliceGrid grid_of(double width_m, double depth_m, std::size_t slices = 3) {
  return {width_m, depth_m, 0.48, {slices, -0.005, 0.005}};
}

TEST(SlicePlane, IsTheMeanOfTheLogarithmsInEachElement) {
  const SliceGrid grid = grid_of(0.004, 0.002);
  ASSERT_EQ(grid.columns(), 2u);
  ASSERT_EQ(grid.rows(), 2u);
  // The node that is not valid, and the one that is no number, count for nothing.
  const SlicePlane plane =
      slice_plane({map_of("youngs_modulus", 4, 2, {1e4, 4e4, 1e9, 5e3, 2e4, kNan, 3e4, 3e4}),
                   map_of("valid", 4, 2, {1, 1, 0, 1, 1, 1, 1, 1}),
                   map_of("youngs_modulus_log_std", 4, 2, {0.1F, 0.3F, 9, 0.2F, 0.4F, 0.4F, 0.5F, 0.7F})},
                  grid);
  const std::vector<float> pa{2e4, 5e3, 2e4, 3e4}, log_std{0.2F, 0.2F, 0.4F, 0.6F};
  for (std::size_t n = 0; n < 4; ++n) {
    EXPECT_NEAR(plane.pa[n], pa[n], 1e-3 * pa[n]) << n;
    EXPECT_NEAR(plane.log_std[n], log_std[n], 1e-6) << n;
  }
}

TEST(SlicePlane, WhatWasNotMeasuredContinuesTheNearestAndSaysSo) {
  const SliceGrid grid = grid_of(0.004, 0.004);  // the image is half as deep
  const std::vector<v1::Map> maps{map_of("youngs_modulus", 4, 2, {1e4, 1e4, 2e4, 2e4, 1e4, 1e4, 2e4, 2e4}),
                                  map_of("valid", 4, 2, std::vector<float>(8, 1)),
                                  map_of("youngs_modulus_log_std", 4, 2, std::vector<float>(8, 0.1F))};
  const SlicePlane plane = slice_plane(maps, grid);
  for (std::size_t n = 0; n < 8; ++n) {
    EXPECT_NEAR(plane.pa[n], n % 2 == 0 ? 1e4 : 2e4, 1) << n;
    EXPECT_NEAR(plane.log_std[n], n < 4 ? 0.1 : std::hypot(0.1, std::numbers::ln2), 1e-6) << n;
  }
  std::vector<v1::Map> nothing = maps;
  nothing[1] = map_of("valid", 4, 2, std::vector<float>(8, 0));
  try {
    slice_plane(nothing, grid);
    FAIL() << "a slice was made of nothing";
  } catch (const ServiceError& error) {
    EXPECT_EQ(error.code, grpc::StatusCode::FAILED_PRECONDITION);
  }
  EXPECT_THROW(slice_plane({maps[0], maps[1]}, grid), ServiceError);
}

// Two changes, on cells of their own: the one everywhere alike, the other of the upper row alone.
TEST(SlicePlane, WhatIsWrongInManyPlacesStaysSoInItsElements) {
  const SliceGrid grid = grid_of(0.004, 0.004);
  v1::Map modes = map_of("youngs_modulus_log_modes", 2, 2, {0.3F, 0.3F, 0.3F, 0.3F, 0.4F, 0.4F, 0, 0});
  modes.mutable_grid()->set_spacing_m(0, 0.003);
  modes.mutable_grid()->add_size(2), modes.mutable_grid()->add_origin_m(0),
      modes.mutable_grid()->add_spacing_m(1);
  // Of the first row nothing is valid; the second is known to 0.5; the image ends there.
  const SlicePlane plane =
      slice_plane({map_of("youngs_modulus", 4, 2, std::vector<float>(8, 1e4)),
                   map_of("valid", 4, 2, {0, 0, 0, 0, 1, 1, 1, 1}),
                   map_of("youngs_modulus_log_std", 4, 2, std::vector<float>(8, 0.5F)), modes},
                  grid);
  ASSERT_EQ(plane.log_modes.size(), 16u);
  for (std::size_t n = 0; n < 8; ++n) {
    EXPECT_NEAR(plane.log_modes[n], 0.3, 1e-6) << n;
    EXPECT_NEAR(plane.log_modes[8 + n], n < 2 ? 0.4 : 0, 1e-6) << n;
  }
  EXPECT_NEAR(plane.log_std[2], 0.5, 1e-6);
  EXPECT_NEAR(plane.log_std[0], std::sqrt(0.25 + 0.16), 1e-6)
      << "above it: its own changes, and what is left";
  EXPECT_NEAR(plane.log_std[4], std::hypot(0.5, std::numbers::ln2), 1e-6) << "below it nobody knows";
}

TEST(SliceVolume, LiesAsTheCommandSlicesWantsIt) {
  const SliceGrid grid = grid_of(0.004, 0.002);
  const MetaImage image = slice_volume(grid, {{1, {{1, 2, 3, 4}, {}}}}, &SlicePlane::pa);
  EXPECT_EQ(image.size, (std::vector<std::size_t>{2, 2, 3}));
  EXPECT_EQ(image.origin, (std::vector<double>{0.001, 0.0005, -0.005}));
  EXPECT_EQ(image.spacing, (std::vector<double>{0.002, 0.001, 0.005}));
  const std::vector<float> values = image.as<float>();
  EXPECT_TRUE(std::isnan(values[3]) && std::isnan(values[8])) << "no slice was published there";
  EXPECT_EQ(std::vector<float>(values.begin() + 4, values.begin() + 8), (std::vector<float>{1, 2, 3, 4}));
}

}  // namespace
}  // namespace teletact::client
