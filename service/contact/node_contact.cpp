#include <Eigen/Core>
#include <Eigen/LU>
#include <span>

#include "service/contact/fingertip.h"
#include "service/contact/touch.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::Matrix2d;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;

// [u_x, u_y] of every node; where only the axial part is asked for, the rest is zero.
MatrixXd both_components(Compliance& compliance, Friction friction, std::span<const std::size_t> nodes,
                         SolveReport& report) {
  if (friction == Friction::kStuck) return compliance.among(nodes, &report);
  const Index n = Index(nodes.size());
  MatrixXd s = MatrixXd::Zero(2 * n, 2 * n);
  const auto axial = Eigen::seqN(1, n, 2);
  s(axial, axial) = compliance.axial_among(nodes, &report);
  return s;
}

}  // namespace

Touch touch_node(const TissueProblem& problem, Compliance& compliance, const Fingertip& tip,
                 const PlanePose& pose, SolveReport& report) {
  const Footprint foot = footprint(tip, pose.x_m, problem.grid.x_m, problem.touchable);
  const Index n = foot.weights.rows();
  Touch touch;
  for (Index k = 0; k < n; ++k) touch.nodes.push_back(foot.first + std::size_t(k));
  const bool stuck = tip.friction == Friction::kStuck;
  const MatrixXd s = both_components(compliance, tip.friction, touch.nodes, report);
  const auto between = [&](int a,
                           int b) {  // 2x2 compliance between the a-th and b-th derivative of the weights
    Matrix2d sum = Matrix2d::Zero();
    for (Index k = 0; k < n; ++k) {
      for (Index l = 0; l < n; ++l)
        sum += foot.weights(k, a) * foot.weights(l, b) * s.block<2, 2>(2 * k, 2 * l);
    }
    return sum;
  };
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
  const Vector2d largest(s.diagonal()(Eigen::seq(0, Eigen::last, 2)).maxCoeff(),
                         s.diagonal()(Eigen::seq(1, Eigen::last, 2)).maxCoeff());
  touch.amplification = amplification(inverse * v, f, largest, touch.energy.gradient);
  for (Index k = 0; k < n; ++k) {
    if (foot.weights(k, 0) > 0)
      touch.width_m += tributary_width_m(problem.grid.x_m, touch.nodes[std::size_t(k)]);
  }
  touch.normal = foot.weights.col(0) * f[1];
  touch.tangential = foot.weights.col(0) * f[0];
  return touch;
}

}  // namespace teletact::service
