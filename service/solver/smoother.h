// Multigrid's smoothers: M, a sum of exact solves on overlapping sets of nodes (additive Schwarz), each
// followed by a Chebyshev step. Near nu = 1/2 what is hard to smooth are displacements without divergence; a
// rotation of one cell of the grid is the smallest of them, and all others are sums of these: so every set
// holds the four nodes of whole cells.
//
// No eigenvalue of M A exceeds the number of classes of sets such that sets of one class do not couple
// (Toselli and Widlund 2005, lemma 2.6): nothing has to be estimated.
#pragma once

#include <memory>

#include "service/solver/chebyshev.h"
#include "service/solver/linear_operator.h"

namespace teletact::service {

template <class T>
class Smoother {
 public:
  virtual ~Smoother() = default;
  // d = old_direction d + new_residual M residual, z += d; from_zero: z = d, whatever it holds. An
  // old_direction of 0 does not read d.
  virtual void step(const Array<T>& residual, Array<T>& d, Array<T>& z, const ChebyshevStep&, bool from_zero,
                    std::size_t count) = 0;
};

// The makers take a stencil (kernels/stencil.clh) on nx x ny nodes; `indefinite` [1] is set to 1 when it is
// found not to be positive definite, else left.

// One set for each cell. Their sum is a 9-point stencil itself. Cells three lines apart do not couple.
template <class T, class S>
std::unique_ptr<Smoother<T>> make_cell_smoother(const Queue&, const Array<S>& stencil, std::size_t nx,
                                                std::size_t ny, Array<int>& indefinite);
constexpr double kLargestCellEigenvalue = 9;

// One set for each row (along_x) or column of cells: for elements stretched across it. Each is solved from
// end to end by one work item.
template <class T, class S>
std::unique_ptr<Smoother<T>> make_line_smoother(const Queue&, const Array<S>& stencil, std::size_t nx,
                                                std::size_t ny, bool along_x, Array<int>& indefinite);
constexpr double kLargestLineEigenvalue = 3;

}  // namespace teletact::service
