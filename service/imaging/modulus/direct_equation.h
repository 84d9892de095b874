// The adjoint-weighted equation of the direct modulus (T3.2; Albocher, Oberai, Barbone, Harari 2009): of the
// stress sigma = sum_k A_k m_k that the measured strain makes of the unknowns m, find m with
//   Int (sum_k A_k grad w_k) . div(sum_k A_k m_k) = 0   for every w that vanishes on the border,
// m given on the whole border.
//   plane strain: m = (p, mu), A_p = -I, A_mu = 2 (eps - tr(eps) / 2 I), p the pressure in the plane, which
//                 keeps 1 / (1 - 2 nu) out of the equation
//   plane stress: m = mu,      A = 2 (eps + nu / (1 - nu) tr(eps) I)
// Bilinear nodes. The divergence is taken of the nodal products A_k m_k, not of A_k and m_k apart: where both
// jump, their product does not, and div(A) m + A grad m of smeared jumps loses a quarter of a contrast of 10.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "service/imaging/modulus/tissue_extent.h"
#include "service/imaging/modulus/window_nodes.h"

namespace teletact::service {

// A general block tridiagonal system with equal blocks (not symmetric), as a grid of nodes numbered column by
// column gives. LU with pivoting inside the blocks; no pivoting between them, so the elimination must be
// stable by itself: `solve` measures the residual.
struct BlockTridiagonal {
  // `count` block rows of `size`: lower[k] x_(k-1) + diagonal[k] x_k + upper[k] x_(k+1) = b_k.
  BlockTridiagonal(Eigen::Index count, Eigen::Index size);
  std::vector<Eigen::MatrixXd> diagonal, lower, upper;
  struct Solution {
    Eigen::MatrixXd x;    // column k is block k
    double residual = 0;  // || b - A x || / || b ||, 0 for b = 0
  };
  // `b`: column k is block k. Throws std::domain_error when a block is singular. The blocks are gone after.
  Solution solve(const Eigen::MatrixXd& b);
};

// On the nodes of the window.
struct DirectProblem {
  Plane plane = Plane::kStrain;
  std::vector<double> xx, yy, xy;     // A_mu / 2
  std::vector<double> shear_modulus;  // read on the border; any unit
  std::vector<double> half_pressure;  // p / 2 in plane strain: read on the border, in that unit
  double stabilisation = 1e-3;        // adds stabilisation x median(yy)^2 Int grad w . grad mu
};

struct DirectSolution {
  std::vector<double> shear_modulus;
  std::vector<double> half_pressure;  // empty in plane stress
  double residual = 0;                // of the linear system, relative
};

// Throws std::domain_error when the strain determines nothing.
DirectSolution solve_direct(const WindowNodes&, const DirectProblem&);

}  // namespace teletact::service
