#include "tests/reference/contact.h"

#include <Eigen/Cholesky>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "tests/reference/elasticity.h"
#include "tests/reference/kkt.h"

namespace teletact::reference {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using Factor = Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>;
using service::Fingertip;
using service::FingertipShape;
using service::Friction;
using service::PlanePose;

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
                           const Factor& factor, const Fingertip& tip, const PlanePose& pose,
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

// The tip's skin over one node: V(g) = b t^2 (-ln s - 3/2 + 2 s - s^2 / 2), s = g / t + 0.12 < 1, with
// t = d h / (h + a), a half of the undeformed overlap, h the node's width, and b = 0.1 / S_yy.
struct Skin {
  double b = 0, t = 0, t_slope = 0;  // t_slope: dt/dd
  double share(double gap) const { return gap / t + 0.12; }
  double pressure(double gap) const {
    const double s = share(gap);
    return s < 1 ? b * t * (1 - s) * (1 - s) / s : 0;
  }
  double energy(double gap) const {
    const double s = share(gap);
    return s < 1 ? b * t * t * (-std::log(s) - 1.5 + 2 * s - s * s / 2) : 0;
  }
  // dV/dt at constant gap: ds/dt = -gap / t^2.
  double energy_by_thickness(double gap) const { return 2 * energy(gap) / t + pressure(gap) * gap / t; }
};

std::vector<Skin> make_skins(const TouchedTissue& tissue, const Factor& factor, const Fingertip& tip,
                             double indentation, const VectorXd& w) {
  const auto& x = tissue.grid.x_m;
  const double round = std::sqrt(2 * tip.radius_m * indentation);
  const double a = round + (tip.shape == FingertipShape::kFlatPunch ? tip.half_width_m : 0);
  std::vector<Skin> skins(x.size());
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double h = (x[std::min(i + 1, x.size() - 1)] - x[i > 0 ? i - 1 : 0]) / 2;
    skins[i].t = indentation * h / (h + a);
    skins[i].t_slope = h / (h + a) - indentation * h / ((h + a) * (h + a)) * round / (2 * indentation);
    if (w[Index(i)] < -2 * indentation) continue;  // far nodes are never asked for theirs
    VectorXd unit = VectorXd::Zero(Index(tissue.grid.dofs()));
    unit[dof(tissue, i, 1)] = 1;
    skins[i].b = 0.1 / factor.solve(unit)[dof(tissue, i, 1)];
  }
  return skins;
}

// A displacement with no node inside the tip: all nodes that would be lie on it.
VectorXd outside_of_tip(const TouchedTissue& tissue, const Eigen::SparseMatrix<double>& k,
                        const Factor& factor, const VectorXd& w) {
  std::vector<bool> on(tissue.grid.nx());
  VectorXd u = VectorXd::Zero(k.rows());
  for (bool inside = true; inside;) {
    inside = false;
    std::vector<std::size_t> columns;
    for (std::size_t i = 0; i < on.size(); ++i) {
      if (!on[i] && u[dof(tissue, i, 1)] < w[Index(i)]) on[i] = inside = true;
      if (on[i]) columns.push_back(i);
    }
    VectorXd prescribed(Index(columns.size()));
    for (std::size_t r = 0; r < columns.size(); ++r) prescribed[Index(r)] = w[Index(columns[r])];
    u = constrained(k, factor, axial_rows(tissue, columns), prescribed, KktMethod::kSparseFactor).x;
  }
  return u;
}

// Gap of every column by damped Newton steps on the displacement: 1/2 u^T K u + sum V(u_y - w).
VectorXd find_gaps(const TouchedTissue& tissue, const Eigen::SparseMatrix<double>& k, const Factor& factor,
                   const std::vector<Skin>& skins, const VectorXd& w) {
  VectorXd u = outside_of_tip(tissue, k, factor, w);
  const auto energy = [&](const VectorXd& at) {
    double sum = at.dot(k * at) / 2;
    for (Index i = 0; i < w.size(); ++i)
      sum += skins[std::size_t(i)].energy(at[dof(tissue, std::size_t(i), 1)] - w[i]);
    return sum;
  };
  const Eigen::SparseMatrix<double> magnitude = k.cwiseAbs();
  Eigen::SparseMatrix<double> matrix;
  for (int round = 0; round < 200; ++round) {
    matrix = k;
    VectorXd residual = -(k * u);
    // What rounding leaves of forces and energy: more than any tolerance at high contrast near nu = 1/2.
    const VectorXd rounding = 1e-15 * (magnitude * u.cwiseAbs());
    double largest = 0;  // of what the skins bear
    for (Index i = 0; i < w.size(); ++i) {
      const Index at = dof(tissue, std::size_t(i), 1);
      const Skin& skin = skins[std::size_t(i)];
      const double s = skin.share(u[at] - w[i]);
      if (s >= 1) continue;
      const double pressure = skin.pressure(u[at] - w[i]);
      residual[at] += pressure;
      largest = std::max(largest, pressure);
      matrix.coeffRef(at, at) += skin.b * (1 / (s * s) - 1);
    }
    const VectorXd step = Factor(matrix).solve(residual);
    double share = 1;  // stay inside of s > 0
    for (Index i = 0; i < w.size(); ++i) {
      const Index at = dof(tissue, std::size_t(i), 1);
      const double room = u[at] - w[i] + 0.12 * skins[std::size_t(i)].t;
      if (step[at] < 0) share = std::min(share, -0.5 * room / step[at]);
    }
    while (share > 1e-10 && energy(u + share * step) > energy(u) + u.cwiseAbs().dot(rounding)) share /= 2;
    u += share * step;
    // Near s = 0 small steps alone say little.
    if (step.lpNorm<Eigen::Infinity>() <= 1e-9 * u.lpNorm<Eigen::Infinity>() &&
        residual.lpNorm<Eigen::Infinity>() <= 1e-8 * largest + rounding.maxCoeff()) {
      VectorXd gaps(w.size());
      for (Index i = 0; i < w.size(); ++i) gaps[i] = u[dof(tissue, std::size_t(i), 1)] - w[i];
      return gaps;
    }
  }
  throw std::logic_error("reference contact: Newton's method did not settle");
}

// What the multipliers of the prescribed gaps say must be what the skins bear there.
void check_conditions(const ContactSolution& result, const std::vector<Skin>& skins, const VectorXd& gaps) {
  const double scale = result.multiplier_n_m.lpNorm<Eigen::Infinity>();
  for (std::size_t r = 0; r < result.columns.size(); ++r) {
    const std::size_t i = result.columns[r];
    const double off = skins[i].pressure(gaps[Index(i)]) + result.multiplier_n_m[Index(r)];
    if (!(std::abs(off) <= 1e-6 * scale))
      throw std::logic_error("reference contact: a node does not bear what its skin does, off by " +
                             std::to_string(off / scale));
  }
}

ContactSolution touch_tip(const TouchedTissue& tissue, const Eigen::SparseMatrix<double>& free_k,
                          const Factor& free_factor, const Fingertip& tip, const PlanePose& pose,
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
  const std::vector<Skin> skins = make_skins(tissue, free_factor, tip, pose.indentation_m, w);
  const VectorXd gaps = find_gaps(tissue, k, factor, skins, w);
  ContactSolution result;
  for (Index i = 0; i < w.size(); ++i) {
    if (skins[std::size_t(i)].share(gaps[i]) < 1) result.columns.push_back(std::size_t(i));
  }
  VectorXd prescribed(Index(result.columns.size()));
  for (Index r = 0; r < prescribed.size(); ++r) {
    const Index i = Index(result.columns[std::size_t(r)]);
    prescribed[r] = w[i] + gaps[i];
  }
  const KktSolution s = constrained(k, factor, axial_rows(tissue, result.columns), prescribed, method);
  result.multiplier_n_m = s.lambda;
  result.displacement_m = s.x;
  check_conditions(result, skins, gaps);
  // -dU/dX = sum lambda_i dw_i/dX - 1/2 sum dk_i/dw dw_i/dX u_x^2, and by the indentation with dw_i = 1 and
  // the skins growing.
  double fx = 0, fy = 0, skin_energy = 0;
  for (Index r = 0; r < s.lambda.size(); ++r) {
    const Index i = Index(result.columns[std::size_t(r)]);
    const Skin& skin = skins[std::size_t(i)];
    fx += s.lambda[r] * slope[i];
    fy += s.lambda[r] - skin.energy_by_thickness(gaps[i]) * skin.t_slope;
    skin_energy += skin.energy(gaps[i]);
  }
  for (Index i = 0; i < w.size(); ++i) {
    if (tie[i] == 0) continue;
    const double u = s.x[dof(tissue, std::size_t(i), 0)], by_overlap = 1.5 * tie[i] / w[i] * u * u;
    fx -= by_overlap * slope[i];
    fy -= by_overlap;
  }
  result.force_n = {tissue.thickness_m * fx, tissue.thickness_m * fy};
  result.energy_j = tissue.thickness_m * (s.x.dot(k * s.x) / 2 + skin_energy);
  return result;
}

}  // namespace

ContactSolution touch(const TouchedTissue& tissue, const Fingertip& tip, const PlanePose& pose,
                      KktMethod method) {
  const auto k = with_fixed(assemble(tissue.grid, tissue.material), fixed_dofs(tissue.grid, tissue.supports));
  const Factor factor(k);
  return tip.shape == FingertipShape::kNode ? touch_node(tissue, k, factor, tip, pose, method)
                                            : touch_tip(tissue, k, factor, tip, pose, method);
}

}  // namespace teletact::reference
