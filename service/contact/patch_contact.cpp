#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <span>

#include "service/contact/active_set.h"
#include "service/contact/fingertip.h"
#include "service/contact/touch.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;

constexpr double kTieShare = 0.01;       // tie compliance over S_xx,ii ...
constexpr double kTieOverlapM = 1e-3;    // ... at this overlap
constexpr int kTieOrder = 3;             // C_i = kTieShare S_xx,ii (kTieOverlapM / w_i)^kTieOrder
constexpr double kTieNegligible = 1e12;  // ties softer than this times S_xx,ii carry nothing

// The unknown nodal forces of a patch: tangential ones of tied nodes first, then the normal ones.
struct Patch {
  std::vector<std::size_t> nodes;  // grid columns
  std::vector<Overlap> overlaps;   // of each node
  std::vector<Index> tied;         // positions in `nodes`
  std::vector<double> tie;         // C_i of each tied node, m per N/m
  ContactProgramme programme;
};

// A of the stuck contact: rows of the tied nodes' tangential forces, then of all normal ones.
void tie_sideways(const MatrixXd& s, Patch& patch) {
  std::vector<Index> unknowns;
  const Index n = Index(patch.nodes.size());
  for (Index k = 0; k < n; ++k) {
    const double w = patch.overlaps[std::size_t(k)].w_m;
    if (w <= 0) continue;
    const double share = kTieShare * std::pow(kTieOverlapM / w, kTieOrder);
    if (share > kTieNegligible) continue;
    patch.tied.push_back(k);
    patch.tie.push_back(share * s(2 * k, 2 * k));
    unknowns.push_back(2 * k);
  }
  for (Index k = 0; k < n; ++k) unknowns.push_back(2 * k + 1);
  patch.programme.a = s(unknowns, unknowns);
  for (std::size_t t = 0; t < patch.tie.size(); ++t) patch.programme.a(Index(t), Index(t)) += patch.tie[t];
}

Patch make_patch(Compliance& compliance, const Fingertip& tip, const ContactPose& pose,
                 std::span<const double> grid_x_m, ColumnRange columns, SolveReport& report) {
  Patch patch;
  for (std::size_t i = columns.first; i <= columns.last; ++i) {
    patch.nodes.push_back(i);
    patch.overlaps.push_back(overlap(tip, pose, grid_x_m[i]));
  }
  const Index n = Index(patch.nodes.size());
  if (tip.friction == Friction::kStuck) {
    tie_sideways(compliance.among(patch.nodes, &report), patch);
  } else {
    patch.programme.a = compliance.axial_among(patch.nodes, &report);
  }
  const Index tied = Index(patch.tied.size());
  patch.programme.w = VectorXd::Zero(tied + n);
  patch.programme.unilateral = n;
  for (Index k = 0; k < n; ++k) patch.programme.w[tied + k] = patch.overlaps[std::size_t(k)].w_m;
  return patch;
}

// Gradient p^T w_q - 1/2 p^T A_q p; second derivative at the active set
// v_q^T A^-1 v_r + p^T w_qr - 1/2 p^T A_qr p with v_q = w_q - A_q p. A varies by its ties alone.
void set_energy(const Patch& patch, const ActiveSetSolution& s, Touch& touch) {
  Energy& energy = touch.energy;
  const Index tied = Index(patch.tied.size()), active = Index(s.active.size());
  Eigen::MatrixX2d v(active, 2);
  for (Index row = 0; row < active; ++row) {
    const Index unknown = s.active[std::size_t(row)];
    const double p = s.p[unknown];
    const bool normal = unknown >= tied;
    const Index node = normal ? unknown - tied : patch.tied[std::size_t(unknown)];
    const Overlap& o = patch.overlaps[std::size_t(node)];
    const Vector2d w_q(o.slope, 1);
    if (normal) {
      v.row(row) = w_q;
      energy.value += p * o.w_m / 2;
      energy.gradient += p * w_q;
      energy.hessian(0, 0) += p * o.curvature_1_m;
      continue;
    }
    // C = c w^-m: dC/dw = -m C / w, d2C/dw2 = m (m + 1) C / w^2.
    const double slope = -kTieOrder * patch.tie[std::size_t(unknown)] / o.w_m;
    v.row(row) = (-slope * p) * w_q;
    energy.gradient -= (slope / 2 * p * p) * w_q;
    energy.hessian += ((kTieOrder + 1) * slope / (2 * o.w_m) * p * p) * w_q * w_q.transpose();
    energy.hessian(0, 0) -= slope / 2 * p * p * o.curvature_1_m;
  }
  const Eigen::MatrixX2d sensitivity = s.factor.solve(v);
  energy.hessian += v.transpose() * sensitivity;
  const VectorXd p = s.p(s.active), diagonal = patch.programme.a.diagonal()(s.active);
  touch.amplification = amplification(sensitivity, p, diagonal, energy.gradient);
}

}  // namespace

Touch touch_patch(const TissueModel& model, Compliance& compliance, const Fingertip& tip,
                  const ContactPose& pose, const ContactOptions& options, SolveReport& report) {
  const auto& x = model.grid().x_m;
  const ColumnRange all = model.touchable_columns();
  const auto begin = x.begin() + all.first, end = x.begin() + all.last + 1;
  Touch touch;
  for (double margin = options.candidate_margin * pose.indentation_m;; margin = 2 * margin + 1e-6) {
    const double reach = reach_m(tip, pose.indentation_m, margin);
    const auto low = std::lower_bound(begin, end, pose.x_m - reach);
    const auto high = std::upper_bound(low, end, pose.x_m + reach);
    if (low == high) return touch;  // between two nodes, above both
    const ColumnRange columns{std::size_t(low - x.begin()), std::size_t(high - x.begin()) - 1};
    const Patch patch = make_patch(compliance, tip, pose, x, columns, report);
    const Index n = Index(patch.nodes.size()), tied = Index(patch.tied.size());
    std::vector<bool> guess(std::size_t(tied + n));
    for (Index k = 0; k < n; ++k) guess[std::size_t(tied + k)] = patch.overlaps[std::size_t(k)].w_m > 0;
    const ActiveSetSolution s = solve_active_set(patch.programme, guess);
    touch.changes += s.changes;
    const bool grow_left = s.p[tied] > 0 && columns.first > all.first;
    const bool grow_right = s.p[tied + n - 1] > 0 && columns.last < all.last;
    if (grow_left || grow_right) continue;
    if (s.active.empty()) return touch;
    set_energy(patch, s, touch);
    touch.nodes = patch.nodes;
    touch.normal = s.p.tail(n);
    touch.tangential = VectorXd::Zero(n);
    for (Index t = 0; t < tied; ++t) touch.tangential[patch.tied[std::size_t(t)]] = s.p[t];
    return touch;
  }
}

}  // namespace teletact::service
