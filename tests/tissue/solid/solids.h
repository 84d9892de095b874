// Blocks of tissue for the tests of solids.
#pragma once

#include <cmath>
#include <cstddef>
#include <functional>
#include <random>

#include "service/tissue/solid/solid_tissue.h"

namespace teletact::service {

// Rows that grow with depth from `first_m` by `growth`, to exactly `depth_m`.
inline std::vector<double> graded_rows(double depth_m, std::size_t layers, double growth) {
  std::vector<double> y{0};
  double height = 1;
  for (std::size_t j = 0; j < layers; ++j, height *= growth) y.push_back(y.back() + height);
  for (double& value : y) value *= depth_m / y.back();
  return y;
}

inline SolidTissue solid(const SolidGrid& grid, double nu,
                         const std::function<double(double x, double y, double z)>& modulus_pa) {
  SolidTissue tissue{grid, {}, nu};
  for (std::size_t j = 0; j < grid.layers(); ++j)
    for (std::size_t k = 0; k < grid.nz; ++k)
      for (std::size_t i = 0; i < grid.nx; ++i)
        tissue.youngs_modulus_pa.push_back(modulus_pa((double(i) + 0.5) * grid.spacing_x_m,
                                                      (grid.y_m[j] + grid.y_m[j + 1]) / 2,
                                                      (double(k) + 0.5) * grid.spacing_z_m));
  return tissue;
}

// 16 x 8 columns of 2 x 2.5 mm, 6 graded layers, 20 mm deep.
inline SolidGrid small_grid() {
  return {16, 8, 0.002, 0.0025, graded_rows(0.020, 6, 1.3)};
}

// 32 x 16 columns; a stiff lump in tissue whose modulus waves along the surface.
inline SolidTissue lump_in_waves() {
  return solid({32, 16, 0.002, 0.0025, graded_rows(0.020, 6, 1.2)}, 0.49, [](double x, double y, double z) {
    return std::hypot(x - 0.03, y - 0.008, z - 0.02) < 0.006 ? 8e4
                                                             : 1e4 * (1 + 0.3 * std::sin(400 * x + 300 * z));
  });
}

// Each element its own modulus, between 10 kPa and `contrast` times that.
inline SolidTissue rough(const SolidGrid& grid, double nu, double contrast) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> share(0, 1);
  return solid(grid, nu, [&](double, double, double) { return 1e4 * std::pow(contrast, share(random)); });
}

}  // namespace teletact::service
