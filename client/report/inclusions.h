// Stiff inclusions in a modulus map, found without knowing the truth, and compared with it.
#pragma once

#include <cstddef>
#include <vector>

#include "client/patient/tissue.h"

namespace teletact::client {

// Modulus on a regular grid: value (i, j) at (x0 + i dx, y0 + j dy), x fastest; not finite or <= 0 = unknown.
struct ModulusGrid {
  std::size_t nx = 0, ny = 0;
  double x0_m = 0, y0_m = 0, dx_m = 0, dy_m = 0;
  std::vector<float> pa;
  double x(std::size_t i) const { return x0_m + static_cast<double>(i) * dx_m; }
  double y(std::size_t j) const { return y0_m + static_cast<double>(j) * dy_m; }
};

struct FoundInclusion {
  double x_m = 0, y_m = 0, diameter_m = 0;  // centroid; of the disc with the same area
  double contrast = 0;                      // median over the inner 70 % of the radius over the background's
};

struct InclusionReport {
  double background_pa = 0;  // median of the known values
  std::vector<FoundInclusion> found;
  std::vector<int> match;             // per true inclusion: index into found, or -1 (missed)
  std::vector<std::size_t> spurious;  // found ones that match no true one
};

// Connected components above the threshold. Throws std::invalid_argument when the map does not fill its grid
// or nothing in it is known.
InclusionReport find_inclusions(const ModulusGrid& map, const std::vector<Inclusion>& truth);

}  // namespace teletact::client
