// Layered tissue solved by Fourier transforms (T8.1): with E = E0(y) the stiffness K0 couples, for each pair
// of wave numbers along x and z, only the rows of nodes: one block tridiagonal system of 3 x 3 blocks. It is
// eliminated from the held bottom up, so that the surface comes last.
//
// With u_y times i the blocks are real, by the element's mirror symmetries; and those of -kz are those of kz
// with u_z's sign turned. So a quarter of the numbers is kept.
#pragma once

#include <cstddef>
#include <vector>

#include "service/tissue/solid/solid_tissue.h"

namespace teletact::service {

// Of S_j, what row j feels with all below it eliminated: its inverse, [row][6 = xx, xy, xz, yy, yz, zz], and
// W_j = S_(j+1)^-1 K0(j+1, j), [row][9, row-major] for all rows but the last; each [kz = 0 .. nz/2][pitch]
// over kx = 0 .. nx/2, zero beyond.
struct LayeredFactor {
  std::size_t pitch = 0;
  std::vector<double> inverse, coupling;
};

// `pitch`: numbers in a row, > nx / 2.
LayeredFactor factor(const SolidGrid&, const LayeredTissue&, double poisson_ratio, std::size_t pitch);

// The transformed compliance of a row of nodes, what lies above it and below in the model,
// [6][kz = 0 .. nz/2][pitch]: of the surface S_0^-1, of row j + 1 S_(j+1)^-1 + W_j G_j W_j^T, G_j that of
// row j.
std::vector<double> row_symbol(const SolidGrid&, const LayeredTissue&, double poisson_ratio,
                               std::size_t pitch, std::size_t row = 0);

}  // namespace teletact::service
