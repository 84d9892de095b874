#include "service/contact/patch_solver.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double kSettled = 1e-9;  // last step over p: the error after it is about the square of that
constexpr std::size_t kMaxIterations = 200;
constexpr double kMinShare = 0.1;          // of p that a step leaves
constexpr std::size_t kBoldIterations = 40;  // that let a node go at once when it is outside of its skin

// Lets nodes in that would be inside their skin without bearing anything, and those go that bear nothing.
void update_active(const PatchProgramme& q, const VectorXd& displacement, PatchSolution& s) {
  const Index first = q.first_node();
  s.active.clear();
  for (Index u = 0; u < first; ++u) s.active.push_back(u);
  for (std::size_t i = 0; i < q.stiffness.size(); ++i) {
    const Index u = first + Index(i);
    if (s.p[u] == 0) {
      const double t = q.thickness_m[i], y = (q.w[u] + t * (1 - kSkinMiddle) - displacement[u]) / t;
      constexpr double kMin = 1e-6, kMax = 0.5;  // of the skin's thickness
      if (y < kMin) continue;
      const double rest = std::min(y, kMax);
      s.p[u] = q.stiffness[i] * t * rest * rest / (1 - rest);
    }
    s.active.push_back(u);
  }
}

}  // namespace

VectorXd first_guess(const PatchProgramme& q, double indentation_m, double edge) {
  VectorXd p = VectorXd::Zero(q.w.size());
  for (Index u = q.first_node(); u < p.size(); ++u)
    p[u] = std::sqrt(std::max(0.0, q.w[u] / indentation_m - edge));
  const double curvature = p.dot(q.a * p);
  if (curvature > 0) p *= p.dot(q.w) / curvature;
  return p;
}

PatchSolution solve_patch(const PatchProgramme& q, VectorXd guess) {
  PatchSolution s;
  s.p = std::move(guess);
  s.skin.resize(q.stiffness.size());
  const Index first = q.first_node();
  VectorXd displacement = q.a * s.p, step;
  Eigen::MatrixXd matrix;
  while (++s.iterations < kMaxIterations) {
    update_active(q, displacement, s);
    displacement.noalias() = q.a * s.p;
    matrix = q.a(s.active, s.active);
    const Index n = Index(s.active.size());
    step.resize(n);
    for (Index k = 0; k < n; ++k) {
      const Index u = s.active[std::size_t(k)];
      step[k] = q.w[u] - displacement[u];
      if (u < first) continue;
      const std::size_t i = std::size_t(u - first);
      s.skin[i] = skin_state(s.p[u], q.stiffness[i], q.thickness_m[i]);
      step[k] += s.skin[i].gap_m;
      matrix(k, k) += s.skin[i].compliance;
    }
    s.factor.factor_and_solve(matrix, step);
    const double largest = s.p.lpNorm<Eigen::Infinity>();
    double change = 0;
    for (Index k = 0; k < n; ++k) {
      const Index u = s.active[std::size_t(k)];
      change = std::max(change, std::abs(step[k]));
      const double least = u < first ? -HUGE_VAL : kMinShare * s.p[u];
      s.p[u] += step[k];
      if (s.p[u] >= least) continue;
      const double within = q.w[u] + q.thickness_m[std::size_t(u - first)] * (1 - kSkinMiddle);
      s.p[u] = s.iterations < kBoldIterations && displacement[u] > within ? 0 : least;
    }
    if (!(change < HUGE_VAL)) break;  // NaN too
    if (change <= kSettled * largest) return s;
    displacement.noalias() = q.a * s.p;
  }
  throw std::domain_error("contact: the contact did not settle; the compliance is too ill-conditioned");
}

}  // namespace teletact::service
