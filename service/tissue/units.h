// Other units in which the same tissue is computed again, for a sample of what rounding does to an answer.
#pragma once

#include "service/tissue/grid.h"

namespace teletact::service {

// Lengths and moduli times these. No powers of two, which would round alike.
struct Units {
  double length = 1, modulus = 1;
};
constexpr Units kOtherUnits[] = {{1.1, 3}, {1.3, 5}, {1.7, 7}, {1.9, 11}, {2.3, 13}, {2.9, 17}};

inline TissueGrid in_units(TissueGrid grid, const Units& units) {
  for (double& x : grid.x_m) x *= units.length;
  for (double& y : grid.y_m) y *= units.length;
  return grid;
}

inline Material in_units(Material material, const Units& units) {
  for (double& e : material.youngs_modulus_pa) e *= units.modulus;
  return material;
}

}  // namespace teletact::service
