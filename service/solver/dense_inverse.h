// The exact solver of multigrid's coarsest level.
#pragma once

#include <cstddef>
#include <vector>

namespace teletact::service {

// Inverse of a symmetric positive definite n x n matrix, row-major, in place; its lower triangle is read. An
// unknown whose pivot has sunk below 1e-13 of its diagonal (nothing holds it, or rounding ate it)
// is left out: its row and column of the result are zero, the rest stays positive definite.
void invert_symmetric(std::vector<double>& matrix, std::size_t n);

}  // namespace teletact::service
