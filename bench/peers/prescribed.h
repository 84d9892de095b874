// The contact as a Dirichlet problem over the free unknowns alone: K_ff u_f = -K_fc w, u = w on the nodes in
// contact, u = 0 on the supports; the multipliers are -(K u) there. For methods that iterate.
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <vector>

#include "bench/peers/contact_case.h"

namespace teletact::bench {

struct PrescribedContact {
  Eigen::SparseMatrix<double, Eigen::RowMajor> matrix;  // K_ff, n x n
  Eigen::VectorXd right;                                // n
  std::vector<Eigen::Index> free;                       // [n], degree of freedom of each unknown
  explicit PrescribedContact(const ContactProblem&);
  // K_ff of the same tissue with a uniform modulus.
  Eigen::SparseMatrix<double> uniform(const ContactProblem&) const;
  // [dof], with what is prescribed.
  Eigen::VectorXd displacement_m(const ContactProblem&, const Eigen::VectorXd& solution) const;
  // On the finger.
  static std::array<double, 2> force_n(const ContactProblem&, const Eigen::VectorXd& displacement_m);
};

}  // namespace teletact::bench
