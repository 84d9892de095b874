// Direct solver for wide, shallow tissue: K u = f with the bottom bonded and sides and top free,
// eliminated column of nodes by column along x. K is block tridiagonal, A_i the diagonal blocks, C_i = K(i,
// i+1):
//   D_0 = A_0,  D_{i+1} = A_{i+1} - C_i^T D_i^-1 C_i,  P_i = D_i^-1 kept.
// A column has n = 2 (ny - 1) unknowns (u_x, u_y from the surface down); cost nx n^3, memory nx n^2 doubles.
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <vector>

#include "client/patient/mesh.h"

namespace teletact::client {

class ColumnSolver {
 public:
  // Throws std::runtime_error when K is not positive definite (never for a valid mesh).
  explicit ColumnSolver(const PatientMesh& mesh);

  // u for forces `f_y` (N per metre of thickness) on the surface nodes, one per column of nodes. Result: u_x,
  // u_y of node (i, j) at 2 (j + ny i), the bonded bottom included.
  std::vector<double> displacement(const Eigen::VectorXd& f_y) const;

  // Normal surface compliance (T4.2), nx x nx: u_y of surface node i under unit f_y on surface node k,
  // m per (N/m).
  Eigen::MatrixXd surface_compliance() const;

 private:
  std::size_t nx_, ny_;
  std::vector<Eigen::MatrixXd> inverse_;               // P_i
  std::vector<Eigen::SparseMatrix<double>> coupling_;  // C_i, nx - 1 of them
};

}  // namespace teletact::client
