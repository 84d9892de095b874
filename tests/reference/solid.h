// Solid linear elasticity on the product's grids, assembled by Gauss quadrature into a sparse matrix in
// double precision, and solved by a sparse factor: what the product's kernels and transforms are held
// against.
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <cstddef>
#include <vector>

#include "service/tissue/solid/solid_tissue.h"  // the plain structs alone

namespace teletact::reference {

// Unknown of component c at node (i, j, k): i + nx (k + nz (3 j + c)), as the product's fields have them; the
// last row of nodes is held and left out.
std::size_t unknown(const service::SolidGrid&, std::size_t i, std::size_t j, std::size_t k, std::size_t c);

Eigen::SparseMatrix<double> assemble(const service::SolidTissue&);

class SolidReference {
 public:
  explicit SolidReference(const service::SolidTissue&);
  const Eigen::SparseMatrix<double>& stiffness() const { return k_; }
  Eigen::VectorXd solve(const Eigen::VectorXd& load) const;
  // Compliance among some unknowns.
  Eigen::MatrixXd compliance(const std::vector<std::size_t>& unknowns) const;

 private:
  Eigen::SparseMatrix<double> k_;
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor_;
};

}  // namespace teletact::reference
