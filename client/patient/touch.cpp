// True contact forces: a small convex program over the surface compliance (T4.2 to T4.5b).
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

#include "client/patient/patient.h"

namespace teletact::client {

namespace {

using Index = Eigen::Index;

struct Indentation {
  Index begin = 0;           // first surface node of the candidates
  Eigen::VectorXd w, dw_dx;  // prescribed displacement per candidate, its derivative by the finger's x
};

// Candidates: every node that the tip, or a bulge half as high as the indentation, could touch.
Indentation indentation_of(const Finger& finger, const std::vector<double>& x_m, double x, double depth) {
  const double flat = finger.shape == FingerShape::kFlatPunch ? finger.half_width_m : 0;
  const double reach = flat + std::sqrt(2 * finger.radius_m * 1.5 * depth) + (x_m[1] - x_m[0]);
  Indentation in;
  std::vector<double> w, dw;
  for (std::size_t i = 0; i < x_m.size(); ++i) {
    const double d = x_m[i] - x;
    if (std::abs(d) > reach) continue;
    if (w.empty()) in.begin = static_cast<Index>(i);
    const double curved = d > 0 ? std::max(0.0, d - flat) : std::min(0.0, d + flat);
    w.push_back(depth - curved * curved / (2 * finger.radius_m));
    dw.push_back(curved / finger.radius_m);
  }
  in.w = Eigen::Map<Eigen::VectorXd>(w.data(), static_cast<Index>(w.size()));
  in.dw_dx = Eigen::Map<Eigen::VectorXd>(dw.data(), static_cast<Index>(dw.size()));
  return in;
}

// Complementarity p >= 0, S p - w >= 0, p.(S p - w) = 0. Whole sets change at a time; should that cycle, one
// node at a time by Murty's least-index rule, which ends for any positive definite S.
Eigen::VectorXd contact_pressure(const Eigen::MatrixXd& s, const Eigen::VectorXd& w) {
  constexpr int kBlockRounds = 40;
  const Index n = w.size();
  Eigen::Array<bool, Eigen::Dynamic, 1> active = w.array() > 0;
  const double gap_slack = 1e-12 * w.cwiseAbs().maxCoeff();
  for (int round = 0;; ++round) {
    std::vector<Index> set;
    for (Index i = 0; i < n; ++i)
      if (active(i)) set.push_back(i);
    Eigen::VectorXd p = Eigen::VectorXd::Zero(n);
    if (!set.empty()) p(set) = s(set, set).llt().solve(w(set)).eval();
    const Eigen::VectorXd gap = s * p - w;
    bool changed = false;
    for (Index i = 0; i < n && !(changed && round >= kBlockRounds); ++i) {
      const bool wrong = active(i) ? p(i) < 0 : gap(i) < -gap_slack;
      if (wrong) active(i) = !active(i), changed = true;
    }
    if (!changed) return p;
  }
}

void check(const Finger& finger, const Tissue& tissue, double x_m, double indentation_m) {
  if (!(x_m >= 0) || !(x_m <= tissue.width_m))
    throw std::invalid_argument("x_m: the finger is outside the tissue; choose 0 to width_m");
  if (!(indentation_m < tissue.depth_m))
    throw std::invalid_argument("indentation_m: must be less than the tissue's depth");
  if (finger.shape != FingerShape::kNode && (!(finger.radius_m > 0) || !std::isfinite(finger.radius_m)))
    throw std::invalid_argument("Finger.radius_m: must be positive");
  if (finger.shape == FingerShape::kFlatPunch &&
      (!(finger.half_width_m >= 0) || !std::isfinite(finger.half_width_m)))
    throw std::invalid_argument("Finger.half_width_m: must be >= 0");
  if (finger.shape == FingerShape::kNode &&
      (!(finger.footprint_m >= 0) || !std::isfinite(finger.footprint_m)))
    throw std::invalid_argument("Finger.footprint_m: must be >= 0");
}

}  // namespace

TouchForce Patient::touch(const Finger& finger, double x_m, double indentation_m) const {
  check(finger, tissue_, x_m, indentation_m);
  if (indentation_m <= 0) return {};
  return finger.shape == FingerShape::kNode ? touch_node(finger, x_m, indentation_m)
                                            : touch_tip(finger, x_m, indentation_m);
}

TouchForce Patient::touch_tip(const Finger& finger, double x_m, double indentation_m) const {
  const Indentation in = indentation_of(finger, mesh_.x_m, x_m, indentation_m);
  const Index n = in.w.size();
  const Eigen::VectorXd p = contact_pressure(compliance_.block(in.begin, in.begin, n, n), in.w);
  TouchForce out;
  // dU/dw = p (envelope theorem), so F = -(dU/dx, dU/d indentation) = -(p . dw/dx, sum p)
  out.force_n = {-p.dot(in.dw_dx) * tissue_.thickness_m, -p.sum() * tissue_.thickness_m};
  out.energy_j = .5 * p.dot(in.w) * tissue_.thickness_m;
  Index first = n, last = -1;
  for (Index i = 0; i < n; ++i)
    if (p(i) > 0) ++out.contact_nodes, first = std::min(first, i), last = i;
  if (last >= first) out.contact_width_m = static_cast<double>(last - first) * (mesh_.x_m[1] - mesh_.x_m[0]);
  return out;
}

// One generalised node: weights g(x - x_i) of unit sum, compliance c = g.S g, U = delta^2 / 2c.
TouchForce Patient::touch_node(const Finger& finger, double x_m, double indentation_m) const {
  const double h = mesh_.x_m[1] - mesh_.x_m[0], sigma = finger.footprint_m;
  const double reach = sigma > 0 ? 5 * sigma + h : h;
  const auto lower = std::lower_bound(mesh_.x_m.begin(), mesh_.x_m.end(), x_m - reach);
  const auto upper = std::upper_bound(mesh_.x_m.begin(), mesh_.x_m.end(), x_m + reach);
  const Index begin = lower - mesh_.x_m.begin(), n = upper - lower;
  Eigen::VectorXd g(n), dg(n);
  for (Index i = 0; i < n; ++i) {
    const double d = x_m - lower[i];
    g(i) = sigma > 0 ? std::exp(-d * d / (2 * sigma * sigma)) : std::max(0.0, 1 - std::abs(d) / h);
    dg(i) = sigma > 0 ? -d / (sigma * sigma) * g(i) : (std::abs(d) < h ? (d > 0 ? -1 / h : 1 / h) : 0.0);
  }
  const double sum = g.sum();
  dg = dg / sum - g * (dg.sum() / (sum * sum));
  g /= sum;
  const Eigen::VectorXd sg = compliance_.block(begin, begin, n, n) * g;
  const double c = g.dot(sg), dc = 2 * dg.dot(sg), thickness = tissue_.thickness_m;
  TouchForce out;
  out.energy_j = indentation_m * indentation_m / (2 * c) * thickness;
  out.force_n = {indentation_m * indentation_m * dc / (2 * c * c) * thickness,
                 -indentation_m / c * thickness};
  out.contact_nodes = static_cast<std::size_t>(n);
  return out;
}

}  // namespace teletact::client
