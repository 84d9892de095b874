// What the two kinds of contact solve have in common: the energy and its derivatives by the pose (T4.5).
#pragma once

#include <Eigen/Core>

#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "service/contact/contact.h"
#include "service/contact/fingertip.h"

namespace teletact::service {

// The energy of a contact by the pose of the tip (T4.5), and what one node adds to its derivatives; of plane
// tissue (pose: X, indentation) as of solid tissue (x, indentation, z). N: components of the pose. U and its
// derivatives. Per metre of thickness in plane tissue.
template <int N>
struct PoseEnergy {
  double value = 0;
  PoseVector<N> gradient = PoseVector<N>::Zero();
  PoseMatrix<N> hessian = PoseMatrix<N>::Zero();
};

// Adds a node that bears p under its skin; returns v_q = w_q + g_t t_q.
template <int N>
PoseVector<N> add_node(double p, const NodeOverlap<N>& o, const SkinState& skin, const SkinEnergy& w,
                       const SkinThickness& t, PoseEnergy<N>& energy) {
  const PoseVector<N> indentation = PoseVector<N>::Unit(1);
  energy.value += w.w;
  energy.gradient += p * o.slope + w.by_t * t.slope * indentation;
  energy.hessian += p * o.curvature;
  energy.hessian(1, 1) += w.by_t2 * t.slope * t.slope + w.by_t * t.curvature_1_m;
  return o.slope + skin.gap_by_t * t.slope * indentation;
}

// Ties of a stuck contact: C_i = 0.01 S_ii (1 mm / w_i)^3 of each tangential force (T4.5a), so that a node
// begins to hold softly.
constexpr int kTieOrder = 3;

// C_i over S_ii at an overlap w > 0; none: so soft that it carries nothing.
inline std::optional<double> tie_share(double overlap_m) {
  constexpr double kShare = 0.01, kOverlapM = 1e-3, kNegligible = 1e12;
  if (!(overlap_m > 0)) return std::nullopt;
  const double share = kShare * std::pow(kOverlapM / overlap_m, kTieOrder);
  if (share > kNegligible) return std::nullopt;
  return share;
}

// Adds a tied force p of compliance C; returns v_q = -dC/dq p.
template <int N>
PoseVector<N> add_tie(double p, double compliance, const NodeOverlap<N>& o, PoseEnergy<N>& energy) {
  // C = c w^-m: dC/dw = -m C / w, d2C/dw2 = m (m + 1) C / w^2.
  const double slope = -kTieOrder * compliance / o.w_m;
  energy.gradient -= (slope / 2 * p * p) * o.slope;
  energy.hessian += ((kTieOrder + 1) * slope / (2 * o.w_m) * p * p) * o.slope * o.slope.transpose();
  energy.hessian -= (slope / 2 * p * p) * o.curvature;
  return (-slope * p) * o.slope;
}

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

// Punch or rounded tip: unilateral contact of a patch of nodes under the tip's skin (fingertip.h). No nodes
// where nothing touches.
Touch touch_patch(const TissueProblem&, Compliance&, const Fingertip&, const PlanePose&,
                  const ContactOptions&, SolveReport&);

}  // namespace teletact::service
