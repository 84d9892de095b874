// A tactile image as it comes: read as the contract says, or not at all.
#include "client/link/tactile_image.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

namespace teletact::client {
namespace {

void set(v1::Array* array, unsigned rows, unsigned columns, float first) {
  array->set_dtype(v1::DATA_TYPE_FLOAT32);
  array->add_shape(rows), array->add_shape(columns);
  std::vector<float> values;
  for (unsigned k = 0; k < rows * columns; ++k) values.push_back(first + static_cast<float>(k));
  array->set_data(values.data(), values.size() * sizeof(float));
}

v1::TactileImage message() {
  v1::TactileImage out;
  out.set_sequence(9);
  for (const double at : {0.05, 0.0, -0.01}) out.add_centre_m(at);
  out.set_pitch_m(0.002);
  set(out.mutable_pressure_pa(), 2, 3, 100);
  set(out.mutable_beyond_homogeneous_pa(), 2, 3, -3);
  out.set_force_n(0.2);
  out.set_outside_n(0.01);
  return out;
}

TEST(TactileImage, IsReadAsItWasSent) {
  const auto image = tactile_from(message());
  ASSERT_TRUE(image);
  EXPECT_EQ(image->sequence, 9U);
  EXPECT_EQ(image->along_x, 3U);
  EXPECT_EQ(image->along_z, 2U);
  EXPECT_NEAR(image->begin_x_m, 0.048, 1e-12);
  EXPECT_NEAR(image->begin_z_m, -0.011, 1e-12);
  EXPECT_EQ(image->pressure_pa, (std::vector<float>{100, 101, 102, 103, 104, 105}));
  EXPECT_EQ(image->beyond_pa, (std::vector<float>{-3, -2, -1, 0, 1, 2}));
  EXPECT_EQ(image->force_n, 0.2);
  EXPECT_EQ(image->outside_n, 0.01);
  v1::TactileImage plane = message();
  plane.clear_beyond_homogeneous_pa();
  EXPECT_TRUE(tactile_from(plane).value().beyond_pa.empty());
}

TEST(TactileImage, IsNotReadWhereAnythingIsWrong) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const std::vector<std::function<void(v1::TactileImage&)>> wrongs = {
      [](auto& m) { m.clear_pressure_pa(); },
      [](auto& m) { m.mutable_pressure_pa()->set_dtype(v1::DATA_TYPE_FLOAT64); },
      [](auto& m) { m.mutable_pressure_pa()->set_shape(0, 3); },
      [](auto& m) { m.mutable_pressure_pa()->set_shape(0, 0); },
      [](auto& m) { m.mutable_pressure_pa()->set_shape(0, 4'000'000'000U); },
      [](auto& m) { m.mutable_pressure_pa()->mutable_data()->pop_back(); },
      [&](auto& m) {
        m.mutable_pressure_pa()->mutable_data()->replace(0, 4, reinterpret_cast<const char*>(&nan), 4);
      },
      [](auto& m) { m.mutable_beyond_homogeneous_pa()->mutable_data()->clear(); },
      [](auto& m) { m.mutable_beyond_homogeneous_pa()->set_shape(1, 2); },
      [](auto& m) { m.mutable_centre_m()->RemoveLast(); },
      [](auto& m) { m.set_centre_m(2, NAN); },
      [](auto& m) { m.set_pitch_m(0); },
      [](auto& m) { m.set_force_n(NAN); },
  };
  for (std::size_t k = 0; k < wrongs.size(); ++k) {
    v1::TactileImage m = message();
    wrongs[k](m);
    EXPECT_FALSE(tactile_from(m)) << k;
  }
}

}  // namespace
}  // namespace teletact::client
