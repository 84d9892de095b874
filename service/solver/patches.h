// Multigrid's smoother: the sum over all cells of the grid of the inverse of the operator on the cell's four
// nodes (an additive overlapping Schwarz method). Near nu = 1/2 what is hard to smooth are displacements
// without divergence; a rotation of one cell is the smallest of them, and all others are sums of these.
#pragma once

#include "service/solver/linear_operator.h"

namespace teletact::service {

// The sum M of a stencil's inverse patches, itself a 9-point stencil (kernels/stencil.clh). `indefinite` [1]
// is set to 1 when a patch is found not to be positive definite, else left.
template <class S>
Array<S> inverse_patches(const Queue&, const Array<S>& stencil, std::size_t nx, std::size_t ny,
                         Array<int>& indefinite);

// No eigenvalue of M A exceeds the number of sets of patches that do not couple with each other: cells three
// lines apart in either direction (Toselli and Widlund 2005, lemma 2.6).
constexpr double kLargestPatchEigenvalue = 9;

}  // namespace teletact::service
