// Solids of plane maps, for the tests of slices.
#pragma once

#include <cmath>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "service/scene/slices.h"
#include "tests/scene/windows.h"

namespace teletact::service {

inline constexpr double kWidthM = 0.048, kDepthM = 0.030, kBallX = 0.024, kBallZ = 0.002;
inline constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// 24 x 10 elements of 2 x 3 mm; 18 of 2 mm along z.
inline ExplicitModulus grid() {
  ExplicitModulus e;
  for (int i = 0; i <= 24; ++i) e.x_m.push_back(kWidthM * i / 24);
  for (int j = 0; j <= 10; ++j) e.y_m.push_back(kDepthM * j / 10);
  for (int k = 0; k <= 18; ++k) e.z_m.push_back(-0.018 + 0.002 * k);
  return e;
}

// What a plane of 10 kPa shows at z of a ball of radius 6 mm, eight times as hard, 9 mm deep.
inline ModulusSlice slice_at(double z_m, double ball_x = kBallX, double hard = 8e4) {
  ModulusSlice slice{z_m, {}, {}, {}};
  for (int j = 0; j < 10; ++j)
    for (int i = 0; i < 24; ++i) {
      const double x = 0.002 * (i + 0.5) - ball_x, y = 0.003 * (j + 0.5) - 0.009;
      slice.youngs_modulus_pa.push_back(std::hypot(x, y, z_m - kBallZ) < 0.006 ? hard : 1e4);
    }
  return slice;
}
inline std::vector<ModulusSlice> slices_at(const std::vector<double>& places) {
  std::vector<ModulusSlice> out;
  for (const double z_m : places) out.push_back(slice_at(z_m));
  return out;
}
inline ExplicitModulus stack(const std::vector<double>& places) {
  return stacked(grid(), slices_at(places), Limits{});
}
inline std::shared_ptr<Scene> scene_of(const ExplicitModulus& e, const MemoryAccount& account = {}) {
  return std::make_shared<Scene>("s", tissue(kWidthM, kDepthM), e, versions(), Limits{}, account);
}

inline std::string why(const std::function<void()>& work) {
  try {
    work();
  } catch (const std::exception& error) {
    return error.what();
  }
  return "taken";
}

inline const std::vector<double> kPlaces{-0.015, -0.01, -0.006, -0.002, 0.002, 0.0061, 0.01, 0.015};

}  // namespace teletact::service
