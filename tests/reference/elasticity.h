// Plane-strain elasticity on a rectilinear grid of bilinear quadrilaterals (Q1), assembled by Gauss
// quadrature into a sparse matrix: the plain text that the product's kernels and eliminations are held
// against. T: double or long double.
//   a(u, v) = Int 2 mu eps(u):eps(v) + lambda div(u) div(v),   mu = E / 2(1 + nu),  lambda = E nu /
//   (1+nu)(1-2nu)
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <cstddef>
#include <functional>
#include <vector>

#include "service/tissue/grid.h"  // the plain structs alone: grid, material, supports

namespace teletact::reference {

enum class Integration {
  kSelectiveReduced,  // T4: the lambda term at the element centre, 2 mu fully
  kFull,              // everything with 2x2 points: locks as nu -> 1/2
};

// Element nodes (i, j), (i+1, j), (i, j+1), (i+1, j+1), two degrees of freedom each; per metre of thickness.
template <class T>
Eigen::Matrix<T, 8, 8> element_matrix(T width_m, T height_m, T youngs_modulus_pa, T poisson_ratio,
                                      Integration);

// Stiffness over all degrees of freedom of the grid, without supports.
template <class T = double>
Eigen::SparseMatrix<T> assemble(const service::TissueGrid&, const service::Material&,
                                Integration = Integration::kSelectiveReduced);

// Degrees of freedom held by the fixed edges, increasing.
std::vector<std::size_t> fixed_dofs(const service::TissueGrid&, const service::Supports&);

// K with the rows and columns of `fixed` replaced by those of a scaled identity: solutions are zero there as
// long as the load is.
Eigen::SparseMatrix<double> with_fixed(const Eigen::SparseMatrix<double>& k,
                                       const std::vector<std::size_t>& fixed);

// Consistent load of a body force (N/m^3) with 3x3 points: Int N_a b.
Eigen::VectorXd body_load(const service::TissueGrid&,
                          const std::function<Eigen::Vector2d(double x_m, double y_m)>& force);

}  // namespace teletact::reference
