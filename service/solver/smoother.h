// Multigrid's smoothers: M, a sum of exact solves on overlapping sets of nodes (additive Schwarz), each
// followed by a Chebyshev step. Near nu = 1/2 what is hard to smooth are displacements without divergence; a
// rotation of one cell of the grid is the smallest of them, and all others are sums of these: so every set
// holds the four nodes of whole cells.
//
// No eigenvalue of M A exceeds the number of classes of sets such that sets of one class do not couple
// (Toselli and Widlund 2005, lemma 2.6): nothing has to be estimated.
#pragma once

#include <cstddef>
#include <vector>

#include "service/solver/linear_operator.h"

namespace teletact::service {

// Build parameters of kernels that write multigrid's planes in W, whatever they compute in.
template <class W>
Defines planes_of() {
  return {{"WORK", sizeof(W) == sizeof(double) ? "double" : "float"}};
}

// Both take a stencil (kernels/stencil.clh) on nx x ny nodes; `indefinite` [1] is set to 1 when it is found
// not to be positive definite, else left.

// One set for each cell: M, a 9-point stencil itself, written to `planes` from `at` on, planes of `stride`
// (kernels/levels.clh). Cells three lines apart do not couple.
template <class S, class W>
void cell_smoother(const Queue&, const Array<S>& stencil, std::size_t nx, std::size_t ny,
                   Array<int>& indefinite, Array<W>& planes, int at, int stride);
constexpr double kLargestCellEigenvalue = 9;

// One set for each row (along_x) or column of cells: for elements stretched across it. The factor of each,
// which one work item solves with from end to end (kernels/lines.cl).
template <class S>
Array<S> line_factor(const Queue&, const Array<S>& stencil, std::size_t nx, std::size_t ny, bool along_x,
                     Array<int>& indefinite);
constexpr double kLargestLineEigenvalue = 3;

// The exact solver of multigrid's coarsest level.
// Inverse of a symmetric positive definite n x n matrix, row-major, in place; its lower triangle is read. An
// unknown whose pivot has sunk below 1e-13 of its diagonal (nothing holds it, or rounding ate it)
// is left out: its row and column of the result are zero, the rest stays positive definite.
void invert_symmetric(std::vector<double>& matrix, std::size_t n);

}  // namespace teletact::service
