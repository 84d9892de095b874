// The convex quadratic programme of unilateral contact.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace teletact::service {

// max over p of p^T w - 1/2 p^T A p with p_i >= 0 for the last `unilateral` unknowns, the others free.
struct ContactProgramme {
  Eigen::MatrixXd a;  // symmetric positive definite
  Eigen::VectorXd w;
  Eigen::Index unilateral = 0;
};

struct ActiveSetSolution {
  Eigen::VectorXd p;                   // zero where released
  std::vector<Eigen::Index> active;    // increasing; free unknowns are always in it
  Eigen::LLT<Eigen::MatrixXd> factor;  // of A over `active`
  std::size_t changes = 0;             // exchanges of the active set
};

// Block principal pivoting (Judice and Pires 1994), falling back to one exchange at a time, which is finite
// for a positive definite A. `guess`: unknowns to start with as active (the unilateral ones among them; any
// set gives the same, unique answer). Throws std::domain_error when A is not positive definite.
ActiveSetSolution solve_active_set(const ContactProgramme&, const std::vector<bool>& guess);

}  // namespace teletact::service
