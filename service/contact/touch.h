// What the two kinds of contact solve have in common: the energy and its derivatives by the pose (T4.5).
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "service/contact/contact.h"
#include "service/contact/pose_energy.h"

namespace teletact::service {

// Where the tip touches: nodal forces (N/m), what the pressure and the strain are made from.
struct Touch {
  PoseEnergy<2> energy;      // of (X, indentation)
  double amplification = 0;  // of the compliance's relative error in the force
  // Relative errors of the force, where they are measured: what samples of the compliance's rounding make,
  // root mean square; the most that rounding as large could make; what unfinished iterations make, about.
  std::size_t samples = 0;
  double sampled_error = 0, max_rounding = 0, unfinished_error = 0;
  std::vector<std::size_t> nodes;
  Eigen::VectorXd normal, tangential;
  double width_m = 0;  // of the contact: what the mean pressure is made with
  std::size_t iterations = 0;
};

// Error of the gradient g of U over its size, for a unit relative error of A (|dA_ij| <= sqrt(A_ii A_jj)): to
// first order dg_q = -(A^-1 v_q)^T dA p. Columns of `sensitivity`: A^-1 v_q, v_q = w_q - A_q p.
double amplification(const Eigen::MatrixX2d& sensitivity, const Eigen::VectorXd& p,
                     const Eigen::VectorXd& diagonal, const Eigen::Vector2d& gradient);

// One node, hat function or footprint: U = max over f of f^T d - 1/2 f^T A(X) f with A = B^T S B, B the
// weights, d = (0, indentation).
Touch touch_node(const TissueProblem&, Compliance&, const Fingertip&, const PlanePose&, SolveReport&);

// Punch or rounded tip: unilateral contact of a patch of nodes under the tip's skin (skin.h). No nodes where
// nothing touches.
Touch touch_patch(const TissueProblem&, Compliance&, const Fingertip&, const PlanePose&,
                  const ContactOptions&, SolveReport&);

}  // namespace teletact::service
