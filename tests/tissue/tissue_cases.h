// Tissue for tests: awkward grids and moduli with known contrast.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "service/tissue/grid.h"

namespace teletact::tests {

inline service::TissueGrid uniform_grid(std::size_t nx, std::size_t ny, double spacing_m = 1e-3) {
  service::TissueGrid grid;
  for (std::size_t i = 0; i < nx; ++i) grid.x_m.push_back(spacing_m * double(i));
  for (std::size_t j = 0; j < ny; ++j) grid.y_m.push_back(spacing_m * double(j));
  return grid;
}

// Unequal spacings in both directions, within a factor of 1.6.
inline service::TissueGrid uneven_grid(std::size_t nx, std::size_t ny) {
  service::TissueGrid grid;
  double x = 0.003, y = 0;
  for (std::size_t i = 0; i < nx; ++i, x += 1e-3 * (1.3 + 0.3 * std::sin(1.7 * double(i))))
    grid.x_m.push_back(x);
  for (std::size_t j = 0; j < ny; ++j, y += 1e-3 * (1.2 + 0.3 * std::cos(2.3 * double(j))))
    grid.y_m.push_back(y);
  return grid;
}

// 10 kPa with a round inclusion `contrast` times as stiff, a third of the depth wide, off the centre.
inline service::Material inclusion(const service::TissueGrid& grid, double contrast, double poisson_ratio) {
  service::Material material;
  material.poisson_ratio = poisson_ratio;
  const double width = grid.x_m.back() - grid.x_m.front(), depth = grid.y_m.back();
  const double cx = grid.x_m.front() + 0.45 * width, cy = 0.4 * depth, radius = depth / 3;
  for (std::size_t j = 0; j + 1 < grid.ny(); ++j) {
    for (std::size_t i = 0; i + 1 < grid.nx(); ++i) {
      const double x = (grid.x_m[i] + grid.x_m[i + 1]) / 2, y = (grid.y_m[j] + grid.y_m[j + 1]) / 2;
      material.youngs_modulus_pa.push_back(std::hypot(x - cx, y - cy) < radius ? 1e4 * contrast : 1e4);
    }
  }
  return material;
}

// Every element another modulus, 10 kPa to 10 kPa * contrast, from a fixed pseudo-random sequence.
inline service::Material scattered(const service::TissueGrid& grid, double contrast, double poisson_ratio) {
  service::Material material;
  material.poisson_ratio = poisson_ratio;
  std::uint32_t state = 12345;
  for (std::size_t e = 0; e < grid.elements(); ++e) {
    state = state * 1664525u + 1013904223u;
    material.youngs_modulus_pa.push_back(1e4 * std::pow(contrast, double(state >> 8) / double(1 << 24)));
  }
  return material;
}

}  // namespace teletact::tests
