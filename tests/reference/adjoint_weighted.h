// The direct modulus's adjoint-weighted equation (T3.2) on a uniform grid of bilinear nodes, assembled node
// by node and solved by a general sparse LU.
#pragma once

#include <cstddef>
#include <vector>

namespace teletact::reference {

// A tensor field T (symmetric; node (i, j) at i + nx j) and unknowns on its nodes: mu, and with `pressure`
// half of p too. Find them with  Int (T grad w - grad q) . (div(T mu) - grad p/2) + stabilisation scale^2
// grad w . grad mu = 0  for all (q, w) that vanish on the border, div(T mu) of the bilinear interpolation of
// T mu.
struct AdjointWeighted {
  std::size_t nx = 0, ny = 0;
  double dx = 1, dy = 1;
  bool with_pressure = true;
  std::vector<double> xx, yy, xy;
  double scale = 1, stabilisation = 0;
  std::vector<double> mu, half_pressure;  // read on the border
};

struct AdjointWeightedSolution {
  std::vector<double> mu, half_pressure;
};

AdjointWeightedSolution solve(const AdjointWeighted&);

}  // namespace teletact::reference
