#include "service/contact/contact.h"

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "service/contact/fingertip.h"
#include "service/contact/touch.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double kPeakStrain = 0.42;  // of (1 + nu) p / E, see solve_contact

void validate(const TissueProblem& problem, std::size_t row, const PlanePose& pose) {
  if (row >= problem.grid.ny()) throw std::out_of_range("row " + std::to_string(row) + " is absent");
  if (!std::isfinite(pose.x_m)) throw std::invalid_argument("pose.x_m is not finite; give metres");
  if (!std::isfinite(pose.indentation_m))
    throw std::invalid_argument("pose.indentation_m is not finite; give metres");
  const double depth = problem.grid.y_m.back() - problem.grid.y_m[row];
  if (pose.indentation_m > 0 && pose.indentation_m >= depth) {
    throw std::invalid_argument(
        fmt::format("pose.indentation_m is {}, but must be below the {} m of tissue below the touched layer; "
                    "press less deep",
                    pose.indentation_m, depth));
  }
}

[[noreturn]] void outside(const TissueProblem& problem, double x_m) {
  const ColumnRange columns = problem.touchable;
  const auto& x = problem.grid.x_m;
  throw std::out_of_range(
      fmt::format("pose.x_m: the tip at {} m overlaps what cannot be touched; nodes from {} to {} m can", x_m,
                  x[columns.first], x[columns.last]));
}

// Every node that the tip overlaps must be one that is served; beside the tissue there is nothing to overlap.
void check_reach(const TissueProblem& problem, const Fingertip& tip, const PlanePose& pose) {
  const auto& x = problem.grid.x_m;
  const ColumnRange columns = problem.touchable;
  if (pose.x_m < x.front() || pose.x_m > x.back()) outside(problem, pose.x_m);
  if (tip.shape == FingertipShape::kNode) {
    if (pose.x_m < x[columns.first] || pose.x_m > x[columns.last]) outside(problem, pose.x_m);
    return;
  }
  const bool left = columns.first > 0 && overlap(tip, pose, x[columns.first - 1]).w_m > 0;
  const bool right = columns.last + 1 < x.size() && overlap(tip, pose, x[columns.last + 1]).w_m > 0;
  const bool beyond = pose.x_m < x[columns.first] || pose.x_m > x[columns.last];
  if (left || right || beyond) outside(problem, pose.x_m);
}

void add_pressure(const TissueProblem& problem, std::size_t row, const Touch& touch, ContactAnswer& answer) {
  const double y_m = problem.grid.y_m[row];
  const auto& x = problem.grid.x_m;
  for (Index k = 0; k < touch.normal.size(); ++k) {
    if (touch.normal[k] == 0 && touch.tangential[k] == 0) continue;
    const std::size_t i = touch.nodes[std::size_t(k)];
    const double width = tributary_width_m(x, i);
    answer.pressure.push_back({{x[i], y_m, 0},
                               touch.normal[k] / width,
                               {touch.tangential[k] / width, 0, 0},
                               {width, problem.thickness_m}});
  }
}

double largest_strain(const TissueProblem& problem, std::size_t row, const PlanePose& pose,
                      const Touch& touch) {
  double force = 0, stiffness = 0;  // stiffness: modulus weighted by the force that it bears
  for (Index k = 0; k < touch.normal.size(); ++k) {
    if (!(touch.normal[k] > 0)) continue;
    force += touch.normal[k];
    stiffness += touch.normal[k] * modulus_near_pa(problem, touch.nodes[std::size_t(k)], row);
  }
  const double depth = problem.grid.y_m.back() - problem.grid.y_m[row];
  const double layer = pose.indentation_m / depth;
  if (!(force > 0)) return layer;
  const double local =
      kPeakStrain * (1 + problem.material.poisson_ratio) * (force / touch.width_m) / (stiffness / force);
  return std::max(layer, local);
}

// `solve.relative_error`: of the compliance, any entry, at most. Where its rounding was sampled, the samples
// say what it does to this force: the fewer, the more may be missed; a touch may by chance be insensitive to
// them, hence the share of the most it could be; and the force is itself a rounded number. What unfinished
// iterations leave is an estimate too. The factors are such that less than 1 % of forces are off by more
// (error_estimate_test). Where a solve did not converge, its own bound is not undercut.
double force_error(const Touch& touch, const SolveReport& solve) {
  const double bound = touch.amplification * solve.relative_error;
  if (touch.samples == 0) return bound;
  constexpr double kUnfinished = 2;
  constexpr double kForceRounding = 1.5 * std::numeric_limits<double>::epsilon();
  const double coverage = 0.6 + 3.6 / double(touch.samples), share = 0.1 / double(touch.samples);
  const double estimate = coverage * std::hypot(touch.sampled_error, share * touch.max_rounding) +
                          kUnfinished * touch.unfinished_error + kForceRounding;
  return solve.converged ? estimate : std::max(estimate, bound);
}

void check_finite(const ContactAnswer& answer) {
  bool finite = std::isfinite(answer.energy_j) && std::isfinite(answer.largest_strain);
  for (double f : answer.force_n) finite = finite && std::isfinite(f);
  for (double k : answer.tangent_n_m) finite = finite && std::isfinite(k);
  for (const NodalPressure& p : answer.pressure)
    finite = finite && std::isfinite(p.pressure_pa) && std::isfinite(p.traction_pa[0]);
  if (!finite)
    throw std::domain_error("contact: the answer is not finite; the model's compliance is unusable");
}

}  // namespace

double amplification(const Eigen::MatrixX2d& sensitivity, const VectorXd& p, const VectorXd& diagonal,
                     const Eigen::Vector2d& gradient) {
  const VectorXd root = diagonal.cwiseSqrt();
  const Eigen::Vector2d error = sensitivity.cwiseAbs().transpose() * root * p.cwiseAbs().dot(root);
  return gradient.norm() > 0 ? error.norm() / gradient.norm() : 0;
}

ContactAnswer solve_contact(const TissueProblem& problem, std::size_t row, Compliance& compliance,
                            const Fingertip& tip, const PlanePose& pose, const ContactOptions& options) {
  validate(tip);
  if (tip.shape == FingertipShape::kPad || tip.shape == FingertipShape::kSphere)
    throw std::invalid_argument(
        "fingertip.shape is a pad or a sphere, which touch solid tissue; here use a flat punch or a rounded "
        "tip");
  validate(problem, row, pose);
  ContactAnswer answer;
  if (pose.indentation_m <= 0) return answer;
  check_reach(problem, tip, pose);
  const Touch touch = tip.shape == FingertipShape::kNode
                          ? touch_node(problem, compliance, tip, pose, answer.solve)
                          : touch_patch(problem, compliance, tip, pose, options, answer.solve);
  answer.iterations = touch.iterations;
  answer.solve.relative_error = force_error(touch, answer.solve);
  if (touch.nodes.empty()) return answer;
  const double thickness = problem.thickness_m;
  const PoseEnergy<2>& u = touch.energy;
  answer.state = ContactState::kContact;
  answer.energy_j = thickness * u.value;
  answer.force_n = {-thickness * u.gradient[0], -thickness * u.gradient[1], 0};
  const double cross = -thickness * (u.hessian(0, 1) + u.hessian(1, 0)) / 2;
  answer.tangent_n_m = {
      -thickness * u.hessian(0, 0), cross, 0, cross, -thickness * u.hessian(1, 1), 0, 0, 0, 0};
  add_pressure(problem, row, touch, answer);
  answer.largest_strain = largest_strain(problem, row, pose, touch);
  answer.strain_beyond_linear = answer.largest_strain > kLargestLinearStrain;
  check_finite(answer);
  return answer;
}

}  // namespace teletact::service
