#include "service/contact/contact.h"

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "service/contact/active_set.h"
#include "service/contact/fingertip.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::Matrix2d;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;

constexpr double kLargestLinearStrain = 0.15;  // T4.5
constexpr double kTieShare = 0.01;             // tie compliance over S_xx,ii ...
constexpr double kTieOverlapM = 1e-3;          // ... at this overlap
constexpr int kTieOrder = 3;                   // C_i = kTieShare S_xx,ii (kTieOverlapM / w_i)^kTieOrder
constexpr double kTieNegligible = 1e12;        // ties softer than this times S_xx,ii carry nothing

// U and its derivatives by the pose (X, indentation), per metre of thickness.
struct Energy {
  double value = 0;
  Vector2d gradient = Vector2d::Zero();
  Matrix2d hessian = Matrix2d::Zero();
};

// Where the tip touches: nodal forces (N/m), what the pressure and the strain are made from.
struct Touch {
  Energy energy;
  std::vector<std::size_t> nodes;
  VectorXd normal, tangential;
  std::size_t changes = 0;
};

void validate(const TissueModel& model, std::size_t line, const ContactPose& pose) {
  if (line >= model.grid().ny()) throw std::out_of_range("line " + std::to_string(line) + " is absent");
  if (!std::isfinite(pose.x_m)) throw std::invalid_argument("pose.x_m is not finite; give metres");
  if (!std::isfinite(pose.indentation_m))
    throw std::invalid_argument("pose.indentation_m is not finite; give metres");
  const double depth = model.grid().y_m.back() - model.grid().y_m[line];
  if (pose.indentation_m > 0 && pose.indentation_m >= depth) {
    throw std::invalid_argument("pose.indentation_m is " + std::to_string(pose.indentation_m) +
                                ", not less than the " + std::to_string(depth) +
                                " m of tissue below the touched line; press less deep");
  }
}

[[noreturn]] void outside(const TissueModel& model, double x_m) {
  const ColumnRange columns = model.touchable_columns();
  const auto& x = model.grid().x_m;
  throw std::out_of_range(
      "pose.x_m: the tip at " + std::to_string(x_m) + " m overlaps what cannot be touched; nodes from " +
      std::to_string(x[columns.first]) + " to " + std::to_string(x[columns.last]) + " m can");
}

// Every node that the tip overlaps must be one that is served; beside the tissue there is nothing to overlap.
void check_reach(const TissueModel& model, const Fingertip& tip, const ContactPose& pose) {
  const auto& x = model.grid().x_m;
  const ColumnRange columns = model.touchable_columns();
  if (pose.x_m < x.front() || pose.x_m > x.back()) outside(model, pose.x_m);
  if (tip.shape == FingertipShape::kNode) {
    if (pose.x_m < x[columns.first] || pose.x_m > x[columns.last]) outside(model, pose.x_m);
    return;
  }
  const bool left = columns.first > 0 && overlap(tip, pose, x[columns.first - 1]).w_m > 0;
  const bool right = columns.last + 1 < x.size() && overlap(tip, pose, x[columns.last + 1]).w_m > 0;
  const bool beyond = pose.x_m < x[columns.first] || pose.x_m > x[columns.last];
  if (left || right || beyond) outside(model, pose.x_m);
}

// --- one node
// -------------------------------------------------------------------------------------------------

// U = max over f of f^T d - 1/2 f^T A(X) f with A = B^T S B, B = weights of the node, d = (0, indentation).
Touch touch_node(const TissueModel& model, Compliance& compliance, const Fingertip& tip,
                 const ContactPose& pose, SolveReport& report) {
  const Footprint foot = footprint(tip, pose.x_m, model.grid().x_m, model.touchable_columns());
  const Index n = foot.weights.rows();
  Touch touch;
  for (Index k = 0; k < n; ++k) touch.nodes.push_back(foot.first + std::size_t(k));
  const MatrixXd s = compliance.among(touch.nodes, &report);
  const auto between = [&](int a,
                           int b) {  // 2x2 compliance between the a-th and b-th derivative of the weights
    Matrix2d sum = Matrix2d::Zero();
    for (Index k = 0; k < n; ++k) {
      for (Index l = 0; l < n; ++l)
        sum += foot.weights(k, a) * foot.weights(l, b) * s.block<2, 2>(2 * k, 2 * l);
    }
    return sum;
  };
  const bool stuck = tip.friction == Friction::kStuck;
  Matrix2d a = between(0, 0), slope = between(0, 1), curvature = between(0, 2);
  slope += slope.transpose().eval();                              // dA/dX
  curvature += curvature.transpose().eval() + 2 * between(1, 1);  // d2A/dX2
  Matrix2d inverse = Matrix2d::Zero();
  if (stuck) {
    inverse = a.inverse();
  } else {
    inverse(1, 1) = 1 / a(1, 1);
  }
  const Vector2d f = inverse * Vector2d(0, pose.indentation_m);
  Eigen::Matrix<double, 2, 2> v;  // columns: d - A_q f by X and by the indentation
  v << -slope * f, Vector2d(0, 1);
  touch.energy.value = f[1] * pose.indentation_m / 2;
  touch.energy.gradient << -f.dot(slope * f) / 2, f[1];
  touch.energy.hessian = v.transpose() * inverse * v;
  touch.energy.hessian(0, 0) -= f.dot(curvature * f) / 2;
  touch.normal = foot.weights.col(0) * f[1];
  touch.tangential = foot.weights.col(0) * f[0];
  return touch;
}

// --- punch and rounded tip
// --------------------------------------------------------------------------------------

// The unknown nodal forces of a patch: tangential ones of tied nodes first, then the normal ones.
struct Patch {
  std::vector<std::size_t> nodes;  // grid columns
  std::vector<Overlap> overlaps;   // of each node
  std::vector<Index> tied;         // positions in `nodes`
  std::vector<double> tie;         // C_i w_i^2 of each tied node, m^3/N
  ContactProgramme programme;
};

Patch make_patch(Compliance& compliance, const Fingertip& tip, const ContactPose& pose,
                 std::span<const double> grid_x_m, ColumnRange columns, SolveReport& report) {
  Patch patch;
  for (std::size_t i = columns.first; i <= columns.last; ++i) {
    patch.nodes.push_back(i);
    patch.overlaps.push_back(overlap(tip, pose, grid_x_m[i]));
  }
  const Index n = Index(patch.nodes.size());
  const MatrixXd s = compliance.among(patch.nodes, &report);
  std::vector<Index> unknowns;
  for (Index k = 0; tip.friction == Friction::kStuck && k < n; ++k) {
    const double w = patch.overlaps[std::size_t(k)].w_m;
    if (w <= 0) continue;
    const double share = kTieShare * std::pow(kTieOverlapM / w, kTieOrder);
    if (share > kTieNegligible) continue;
    patch.tied.push_back(k);
    patch.tie.push_back(share * s(2 * k, 2 * k));
    unknowns.push_back(2 * k);
  }
  const Index tied = Index(patch.tied.size());
  for (Index k = 0; k < n; ++k) unknowns.push_back(2 * k + 1);
  patch.programme.a = s(unknowns, unknowns);
  patch.programme.w = VectorXd::Zero(tied + n);
  patch.programme.unilateral = n;
  for (Index t = 0; t < tied; ++t) {
    patch.programme.a(t, t) += patch.tie[std::size_t(t)];
  }
  for (Index k = 0; k < n; ++k) patch.programme.w[tied + k] = patch.overlaps[std::size_t(k)].w_m;
  return patch;
}

// Gradient p^T w_q - 1/2 p^T A_q p; second derivative at the active set
// v_q^T A^-1 v_r + p^T w_qr - 1/2 p^T A_qr p with v_q = w_q - A_q p. A varies by its ties alone.
Energy energy_of(const Patch& patch, const ActiveSetSolution& s) {
  Energy energy;
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
  const Eigen::MatrixX2d half = s.factor.matrixL().solve(v);
  energy.hessian += half.transpose() * half;
  return energy;
}

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
    touch.energy = energy_of(patch, s);
    touch.nodes = patch.nodes;
    touch.normal = s.p.tail(n);
    touch.tangential = VectorXd::Zero(n);
    for (Index t = 0; t < tied; ++t) touch.tangential[patch.tied[std::size_t(t)]] = s.p[t];
    return touch;
  }
}

// --- the answer
// -------------------------------------------------------------------------------------------------

void add_pressure(const TissueModel& model, const Touch& touch, ContactAnswer& answer) {
  const auto& x = model.grid().x_m;
  for (Index k = 0; k < touch.normal.size(); ++k) {
    if (touch.normal[k] == 0 && touch.tangential[k] == 0) continue;
    const std::size_t i = touch.nodes[std::size_t(k)];
    const double width = tributary_width_m(x, i);
    answer.pressure.push_back({x[i], touch.normal[k] / width, touch.tangential[k] / width});
  }
}

double largest_strain(const TissueModel& model, std::size_t line, const ContactPose& pose,
                      const Touch& touch) {
  double force = 0, width = 0, stiffness = 0;  // stiffness: modulus weighted by the force that it bears
  for (Index k = 0; k < touch.normal.size(); ++k) {
    if (!(touch.normal[k] > 0)) continue;
    const std::size_t i = touch.nodes[std::size_t(k)];
    force += touch.normal[k];
    width += tributary_width_m(model.grid().x_m, i);
    stiffness += touch.normal[k] * model.modulus_near_pa(i, line);
  }
  const double depth = model.grid().y_m.back() - model.grid().y_m[line];
  const double layer = pose.indentation_m / depth;
  if (!(force > 0)) return layer;
  const double hertz = 0.38 * (1 + model.material().poisson_ratio) * (force / width) / (stiffness / force);
  return std::max(layer, hertz);
}

void check_finite(const ContactAnswer& answer) {
  bool finite = std::isfinite(answer.energy_j) && std::isfinite(answer.largest_strain);
  for (double f : answer.force_n) finite = finite && std::isfinite(f);
  for (double k : answer.tangent_n_m) finite = finite && std::isfinite(k);
  for (const NodalPressure& p : answer.pressure) {
    finite = finite && std::isfinite(p.pressure_pa) && std::isfinite(p.traction_pa);
  }
  if (!finite)
    throw std::domain_error("contact: the answer is not finite; the model's compliance is unusable");
}

}  // namespace

ContactAnswer solve_contact(const TissueModel& model, std::size_t line, Compliance& compliance,
                            const Fingertip& tip, const ContactPose& pose, const ContactOptions& options) {
  validate(tip);
  validate(model, line, pose);
  ContactAnswer answer;
  if (pose.indentation_m <= 0) return answer;
  check_reach(model, tip, pose);
  const Touch touch = tip.shape == FingertipShape::kNode
                          ? touch_node(model, compliance, tip, pose, answer.solve)
                          : touch_patch(model, compliance, tip, pose, options, answer.solve);
  answer.active_set_changes = touch.changes;
  if (touch.nodes.empty()) return answer;
  const double thickness = model.options().thickness_m;
  const Energy& u = touch.energy;
  answer.state = ContactState::kContact;
  answer.energy_j = thickness * u.value;
  answer.force_n = {-thickness * u.gradient[0], -thickness * u.gradient[1]};
  const double cross = -thickness * (u.hessian(0, 1) + u.hessian(1, 0)) / 2;
  answer.tangent_n_m = {-thickness * u.hessian(0, 0), cross, cross, -thickness * u.hessian(1, 1)};
  add_pressure(model, touch, answer);
  answer.largest_strain = largest_strain(model, line, pose, touch);
  answer.strain_beyond_linear = answer.largest_strain > kLargestLinearStrain;
  check_finite(answer);
  return answer;
}

}  // namespace teletact::service
