#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <span>

#include "service/contact/fingertip.h"
#include "service/contact/patch_solver.h"
#include "service/contact/touch.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;

constexpr double kHalfPlaneEdge = 0.48;  // of a contact on a half plane (first_guess)

// The unknown nodal forces of a patch: tangential ones of tied nodes first, then the normal ones.
struct Patch {
  std::vector<std::size_t> nodes;        // grid columns
  std::vector<NodeOverlap<2>> overlaps;  // of each node
  std::vector<Index> tied;               // positions in `nodes`
  std::vector<double> tie;               // C_i of each tied node, m per N/m
  std::vector<SkinThickness> skin;       // of each node
  PatchProgramme programme;
};

// A of the stuck contact: rows of the tied nodes' tangential forces, then of all normal ones.
void tie_sideways(const MatrixXd& s, Patch& patch) {
  std::vector<Index> unknowns;
  const Index n = Index(patch.nodes.size());
  for (Index k = 0; k < n; ++k) {
    const auto share = tie_share(patch.overlaps[std::size_t(k)].w_m);
    if (!share) continue;
    patch.tied.push_back(k);
    patch.tie.push_back(*share * s(2 * k, 2 * k));
    unknowns.push_back(2 * k);
  }
  for (Index k = 0; k < n; ++k) unknowns.push_back(2 * k + 1);
  patch.programme.a = s(unknowns, unknowns);
  for (std::size_t t = 0; t < patch.tie.size(); ++t) patch.programme.a(Index(t), Index(t)) += patch.tie[t];
}

Patch make_patch(Compliance& compliance, const Fingertip& tip, const PlanePose& pose,
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
  for (Index k = 0; k < n; ++k) {
    const std::size_t node = std::size_t(k);
    patch.programme.w[tied + k] = patch.overlaps[node].w_m;
    const double width_m = tributary_width_m(grid_x_m, patch.nodes[node]);
    patch.skin.push_back(skin_thickness(tip, pose.indentation_m, width_m));
    patch.programme.thickness_m.push_back(patch.skin.back().t_m);
    patch.programme.stiffness.push_back(kSkinStiffness / patch.programme.a(tied + k, tied + k));
  }
  return patch;
}

// What an error dA of the compliance does to the gradient: (A^-1 v_q)^T dA p.
void set_measured_error(const Compliance& compliance, const Patch& patch, const std::vector<Index>& active,
                        const Eigen::MatrixX2d& sensitivity, const VectorXd& p, Touch& touch) {
  const Index tied = Index(patch.tied.size());
  std::vector<std::size_t> unknowns;
  unknowns.reserve(active.size());
  for (const Index unknown : active) {
    const bool normal = unknown >= tied;
    const Index node = normal ? unknown - tied : patch.tied[std::size_t(unknown)];
    unknowns.push_back(2 * patch.nodes[std::size_t(node)] + (normal ? 1 : 0));
  }
  const auto error = compliance.error_between(unknowns, sensitivity, p);
  if (!error) return;
  const double gradient = touch.energy.gradient.norm();
  double squares = 0;
  for (const Vector2d& sample : error->rounding) squares += sample.squaredNorm();
  touch.samples = error->rounding.size();
  touch.sampled_error = std::sqrt(squares / double(error->rounding.size())) / gradient;
  touch.max_rounding = touch.amplification * error->largest_rounding;
  touch.unfinished_error = error->unfinished.norm() / gradient;
}

// Gradient p^T w_q + W_t t_q - 1/2 p^T A_q p; second derivative v_q^T (A + D)^-1 v_r + p^T w_qr + W_tt t_q
// t_r + W_t t_qr - 1/2 p^T A_qr p with v_q = w_q + g_t t_q - A_q p. A varies by its ties alone, the skin with
// the indentation.
void set_energy(const Compliance& compliance, const Patch& patch, const PatchSolution& s, Touch& touch) {
  PoseEnergy<2>& energy = touch.energy;
  const Index tied = Index(patch.tied.size()), active = Index(s.active.size());
  Eigen::MatrixX2d v(active, 2);
  energy.value = s.p.dot(patch.programme.w) - s.p.dot(patch.programme.a * s.p) / 2;
  for (Index row = 0; row < active; ++row) {
    const Index unknown = s.active[std::size_t(row)];
    const double p = s.p[unknown];
    const bool normal = unknown >= tied;
    const std::size_t node = std::size_t(normal ? unknown - tied : patch.tied[std::size_t(unknown)]);
    const NodeOverlap<2>& o = patch.overlaps[node];
    if (!normal) {
      v.row(row) = add_tie(p, patch.tie[std::size_t(unknown)], o, energy);
      continue;
    }
    const SkinThickness& t = patch.skin[node];
    const SkinEnergy w = skin_energy(s.skin[node], p, patch.programme.stiffness[node], t.t_m);
    v.row(row) = add_node(p, o, s.skin[node], w, t, energy);
  }
  Eigen::MatrixX2d sensitivity = v;
  s.factor.solve(sensitivity.col(0));
  s.factor.solve(sensitivity.col(1));
  energy.hessian += v.transpose() * sensitivity;
  const VectorXd p = s.p(s.active), diagonal = patch.programme.a.diagonal()(s.active);
  touch.amplification = amplification(sensitivity, p, diagonal, energy.gradient);
  set_measured_error(compliance, patch, s.active, sensitivity, p, touch);
}

// Width of evenly spread forces that have the same mean, weighted by themselves.
double effective_width_m(const VectorXd& force, std::span<const std::size_t> nodes,
                         std::span<const double> grid_x_m) {
  double sum = 0, squares = 0;
  for (Index k = 0; k < force.size(); ++k) {
    sum += force[k];
    squares += force[k] * force[k] / tributary_width_m(grid_x_m, nodes[std::size_t(k)]);
  }
  return squares > 0 ? sum * sum / squares : 0;
}

}  // namespace

Touch touch_patch(const TissueProblem& problem, Compliance& compliance, const Fingertip& tip,
                  const PlanePose& pose, const ContactOptions& options, SolveReport& report) {
  const auto& x = problem.grid.x_m;
  const ColumnRange all = problem.touchable;
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
    const PatchSolution s =
        solve_patch(patch.programme, first_guess(patch.programme, pose.indentation_m, kHalfPlaneEdge));
    touch.iterations += s.iterations;
    const bool grow_left = s.p[tied] > 0 && columns.first > all.first;
    const bool grow_right = s.p[tied + n - 1] > 0 && columns.last < all.last;
    if (grow_left || grow_right) continue;
    if (!(s.p.tail(n).maxCoeff() > 0)) return touch;
    set_energy(compliance, patch, s, touch);
    touch.nodes = patch.nodes;
    touch.normal = s.p.tail(n);
    touch.width_m = effective_width_m(touch.normal, touch.nodes, x);
    touch.tangential = VectorXd::Zero(n);
    for (Index t = 0; t < tied; ++t) touch.tangential[patch.tied[std::size_t(t)]] = s.p[t];
    return touch;
  }
}

}  // namespace teletact::service
