#include "tests/reference/contact.h"

#include <Eigen/Cholesky>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "tests/reference/elasticity.h"
#include "tests/reference/kkt.h"

namespace teletact::reference {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Factor = Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>;
using service::ContactPose;
using service::Fingertip;
using service::FingertipShape;
using service::Friction;

// Tie of the stuck contact: compliance 0.01 S_xx (1 mm / w)^3, so stiffness k = w^3 / (0.01 S_xx 1e-9).
constexpr double kTieShare = 0.01, kTieOverlapM = 1e-3;

Index dof(const TouchedTissue& tissue, std::size_t column, int component) {
  return Index(2 * tissue.grid.node(column, tissue.line)) + component;
}

// Height of the tip's surface above its lowest point, d beside its centre, and its slope.
std::pair<double, double> tip_surface(const Fingertip& tip, double d) {
  const double beyond =
      tip.shape == FingertipShape::kFlatPunch ? std::max(0.0, std::abs(d) - tip.half_width_m) : std::abs(d);
  return {beyond * beyond / (2 * tip.radius_m), std::copysign(beyond / tip.radius_m, d)};
}

// Displacement and multipliers under B u = w, K holding supports and springs.
KktSolution constrained(const Eigen::SparseMatrix<double>& k, const Factor& factor, const MatrixXd& b,
                        const VectorXd& w, KktMethod method) {
  const VectorXd no_load = VectorXd::Zero(k.rows());
  if (method == KktMethod::kDense) return solve_kkt(k, b, no_load, w);
  const MatrixXd columns = factor.solve(MatrixXd(b.transpose()));  // K^-1 B^T
  const VectorXd p = (b * columns).ldlt().solve(w);
  return {columns * p, -p};
}

// Rows of B that pick the axial displacement of some columns of the line.
MatrixXd axial_rows(const TouchedTissue& tissue, const std::vector<std::size_t>& columns) {
  MatrixXd b = MatrixXd::Zero(Index(columns.size()), Index(tissue.grid.dofs()));
  for (std::size_t r = 0; r < columns.size(); ++r) b(Index(r), dof(tissue, columns[r], 1)) = 1;
  return b;
}

// --- one node
// -------------------------------------------------------------------------------------------------

// Weights of the nodes under a single-node tip at x, and their derivatives by x.
struct Weights {
  VectorXd value, slope;
};

Weights node_weights(const TouchedTissue& tissue, const Fingertip& tip, double x) {
  const auto& grid = tissue.grid.x_m;
  VectorXd g = VectorXd::Zero(Index(grid.size())), dg = g;
  for (std::size_t i = 0; i < grid.size(); ++i) {
    const double left = i > 0 ? grid[i] - grid[i - 1] : 0,
                 right = i + 1 < grid.size() ? grid[i + 1] - grid[i] : 0;
    const double d = x - grid[i], variance = tip.footprint_m * tip.footprint_m;
    if (variance > 0) {
      // The trapezoidal rule's weight of the node times the Gaussian.
      g[Index(i)] = (left + right) / 2 * std::exp(-d * d / (2 * variance));
      dg[Index(i)] = -d / variance * g[Index(i)];
    } else if (d <= 0 && d >= -left) {
      g[Index(i)] = left > 0 ? 1 + d / left : 1;
      dg[Index(i)] = left > 0 ? 1 / left : 0;
    } else if (d > 0 && d <= right) {
      g[Index(i)] = 1 - d / right;
      dg[Index(i)] = -1 / right;
    }
  }
  return {g / g.sum(), (dg - g * (dg.sum() / g.sum())) / g.sum()};
}

ContactSolution touch_node(const TouchedTissue& tissue, const Eigen::SparseMatrix<double>& k,
                           const Factor& factor, const Fingertip& tip, const ContactPose& pose,
                           KktMethod method) {
  const bool stuck = tip.friction == Friction::kStuck;
  const auto rows = [&](const VectorXd& weights) {
    MatrixXd b = MatrixXd::Zero(stuck ? 2 : 1, Index(tissue.grid.dofs()));
    for (std::size_t i = 0; i < tissue.grid.nx(); ++i) {
      b(0, dof(tissue, i, 1)) = weights[Index(i)];
      if (stuck) b(1, dof(tissue, i, 0)) = weights[Index(i)];
    }
    return b;
  };
  const Weights weights = node_weights(tissue, tip, pose.x_m);
  VectorXd w = VectorXd::Zero(stuck ? 2 : 1);
  w[0] = pose.indentation_m;
  const KktSolution solution = constrained(k, factor, rows(weights.value), w, method);
  // Moving the constraint over the deformed tissue: dU/dX = lambda^T (dB/dX) u.
  ContactSolution result;
  result.force_n = {-tissue.thickness_m * solution.lambda.dot(rows(weights.slope) * solution.x),
                    tissue.thickness_m * solution.lambda[0]};
  result.energy_j = tissue.thickness_m * solution.x.dot(k * solution.x) / 2;
  for (std::size_t i = 0; i < tissue.grid.nx(); ++i) {
    if (weights.value[Index(i)] > 0) result.columns.push_back(i);
  }
  result.multiplier_n_m = solution.lambda;
  result.displacement_m = solution.x;
  return result;
}

// --- punch and rounded tip
// -------------------------------------------------------------------------------------

// Exchange tension against penetration until neither is left.
std::vector<std::size_t> find_active(const TouchedTissue& tissue, const Eigen::SparseMatrix<double>& k,
                                     const Factor& factor, const VectorXd& w) {
  std::vector<bool> in(tissue.grid.nx());
  for (std::size_t i = 0; i < in.size(); ++i) in[i] = w[Index(i)] > 0;
  for (int round = 0; round < 100; ++round) {
    std::vector<std::size_t> active;
    for (std::size_t i = 0; i < in.size(); ++i) {
      if (in[i]) active.push_back(i);
    }
    VectorXd prescribed(Index(active.size()));
    for (std::size_t r = 0; r < active.size(); ++r) prescribed[Index(r)] = w[Index(active[r])];
    const KktSolution s =
        constrained(k, factor, axial_rows(tissue, active), prescribed, KktMethod::kSparseFactor);
    bool settled = true;
    for (std::size_t r = 0; r < active.size(); ++r) {
      if (s.lambda[Index(r)] > 0) in[active[r]] = settled = false;
    }
    if (!settled) continue;  // first let go of what pulls, then look for what is inside the tip
    for (std::size_t i = 0; i < in.size(); ++i) {
      if (!in[i] && s.x[dof(tissue, i, 1)] < w[Index(i)] - 1e-15) {
        in[i] = true;
        settled = false;
      }
    }
    if (settled) return active;
  }
  throw std::logic_error("reference contact: the active set did not settle");
}

// Stiffness of the tangential tie of each column, N/m per metre of thickness.
VectorXd tie_stiffness(const TouchedTissue& tissue, const Factor& factor, const VectorXd& w) {
  VectorXd stiffness = VectorXd::Zero(w.size());
  for (Index i = 0; i < w.size(); ++i) {
    if (w[i] <= 0) continue;
    VectorXd unit = VectorXd::Zero(Index(tissue.grid.dofs()));
    unit[dof(tissue, std::size_t(i), 0)] = 1;
    const VectorXd u = factor.solve(unit);
    const double s_xx = u[dof(tissue, std::size_t(i), 0)];
    stiffness[i] = std::pow(w[i] / kTieOverlapM, 3) / (kTieShare * s_xx);
  }
  return stiffness;
}

// Every node that does not touch is outside the tip, every one that does is pushed.
void check_conditions(const TouchedTissue& tissue, const ContactSolution& result, const VectorXd& w) {
  if (result.multiplier_n_m.size() > 0 && !(result.multiplier_n_m.maxCoeff() <= 0)) {
    throw std::logic_error("reference contact: a node in contact pulls");
  }
  for (std::size_t i = 0; i < tissue.grid.nx(); ++i) {
    if (!(result.displacement_m[dof(tissue, i, 1)] >= w[Index(i)] - 1e-11)) {
      throw std::logic_error("reference contact: a node is inside the tip");
    }
  }
}

ContactSolution touch_tip(const TouchedTissue& tissue, const Eigen::SparseMatrix<double>& free_k,
                          const Factor& free_factor, const Fingertip& tip, const ContactPose& pose,
                          KktMethod method) {
  const auto& x = tissue.grid.x_m;
  VectorXd w(Index(x.size())), slope(Index(x.size()));  // overlap and its derivative by X
  for (std::size_t i = 0; i < x.size(); ++i) {
    const auto [height, rise] = tip_surface(tip, x[i] - pose.x_m);
    w[Index(i)] = pose.indentation_m - height;
    slope[Index(i)] = rise;
  }
  Eigen::SparseMatrix<double> k = free_k;
  VectorXd tie = VectorXd::Zero(w.size());
  if (tip.friction == Friction::kStuck) tie = tie_stiffness(tissue, free_factor, w);
  for (Index i = 0; i < w.size(); ++i)
    k.coeffRef(dof(tissue, std::size_t(i), 0), dof(tissue, std::size_t(i), 0)) += tie[i];
  const Factor factor(k);
  ContactSolution result;
  result.columns = find_active(tissue, k, factor, w);
  VectorXd prescribed(Index(result.columns.size()));
  for (Index r = 0; r < prescribed.size(); ++r) prescribed[r] = w[Index(result.columns[std::size_t(r)])];
  const KktSolution s = constrained(k, factor, axial_rows(tissue, result.columns), prescribed, method);
  result.multiplier_n_m = s.lambda;
  result.displacement_m = s.x;
  check_conditions(tissue, result, w);
  // -dU/dX = sum lambda_i dw_i/dX - 1/2 sum dk_i/dw dw_i/dX u_x^2, and by the indentation with dw_i = 1.
  double fx = 0, fy = 0;
  for (Index r = 0; r < s.lambda.size(); ++r) {
    fx += s.lambda[r] * slope[Index(result.columns[std::size_t(r)])];
    fy += s.lambda[r];
  }
  for (Index i = 0; i < w.size(); ++i) {
    if (tie[i] == 0) continue;
    const double u = s.x[dof(tissue, std::size_t(i), 0)], by_overlap = 1.5 * tie[i] / w[i] * u * u;
    fx -= by_overlap * slope[i];
    fy -= by_overlap;
  }
  result.force_n = {tissue.thickness_m * fx, tissue.thickness_m * fy};
  result.energy_j = tissue.thickness_m * s.x.dot(k * s.x) / 2;
  return result;
}

}  // namespace

ContactSolution touch(const TouchedTissue& tissue, const Fingertip& tip, const ContactPose& pose,
                      KktMethod method) {
  const auto k = with_fixed(assemble(tissue.grid, tissue.material), fixed_dofs(tissue.grid, tissue.supports));
  const Factor factor(k);
  return tip.shape == FingertipShape::kNode ? touch_node(tissue, k, factor, tip, pose, method)
                                            : touch_tip(tissue, k, factor, tip, pose, method);
}

}  // namespace teletact::reference
