// Prescribed displacements by Lagrange multipliers (T4.1; eq. 5 of the paper), dense, by Gaussian
// elimination:
//   [K  B^T] [x     ]   [f]
//   [B  0  ] [lambda] = [w]
// The multipliers are the reaction forces: lambda < 0 where something is pushed along +.
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>

namespace teletact::reference {

struct KktSolution {
  Eigen::VectorXd x;       // displacement of every degree of freedom
  Eigen::VectorXd lambda;  // one per row of B
};

// K: n x n, B: m x n of full row rank, f: n, w: m. Throws std::domain_error when the solution is not finite.
KktSolution solve_kkt(const Eigen::SparseMatrix<double>& k, const Eigen::MatrixXd& b,
                      const Eigen::VectorXd& f, const Eigen::VectorXd& w);

}  // namespace teletact::reference
