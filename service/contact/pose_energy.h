// The energy of a contact by the pose of the tip (T4.5), and what one node adds to its derivatives; of plane
// tissue (pose: X, indentation) as of solid tissue (x, indentation, z). N: components of the pose.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <optional>

#include "service/contact/fingertip.h"
#include "service/contact/skin.h"

namespace teletact::service {

// U and its derivatives. Per metre of thickness in plane tissue.
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

}  // namespace teletact::service
