#include "service/contact/active_set.h"

#include <limits>
#include <stdexcept>

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

// p on the active set: A_AA p_A = w_A.
void solve_on(const ContactProgramme& qp, const std::vector<bool>& in, ActiveSetSolution& s) {
  s.active.clear();
  for (Index i = 0; i < Index(in.size()); ++i) {
    if (in[std::size_t(i)]) s.active.push_back(i);
  }
  s.p = VectorXd::Zero(qp.w.size());
  if (s.active.empty()) return;
  s.factor.compute(qp.a(s.active, s.active));
  if (s.factor.info() != Eigen::Success) {
    throw std::domain_error("contact: the compliance of the contact nodes is not positive definite");
  }
  const VectorXd on_active = s.factor.solve(VectorXd(qp.w(s.active)));
  s.p(s.active) = on_active;
}

// Unilateral unknowns on the wrong side: active in tension, or released but overlapped.
std::vector<Index> infeasible(const ContactProgramme& qp, const std::vector<bool>& in,
                              const ActiveSetSolution& s) {
  const VectorXd gap = qp.w - qp.a * s.p;  // overlap that is left, > 0 is penetration
  const double eps = 64 * std::numeric_limits<double>::epsilon();
  const double gap_slack = eps * qp.w.lpNorm<Eigen::Infinity>();
  const double p_slack = eps * s.p.lpNorm<Eigen::Infinity>();
  std::vector<Index> wrong;
  for (Index i = qp.w.size() - qp.unilateral; i < qp.w.size(); ++i) {
    if (in[std::size_t(i)] ? s.p[i] < -p_slack : gap[i] > gap_slack) wrong.push_back(i);
  }
  return wrong;
}

}  // namespace

ActiveSetSolution solve_active_set(const ContactProgramme& qp, const std::vector<bool>& guess) {
  std::vector<bool> in = guess;
  const Index bound = qp.w.size() - qp.unilateral;
  for (Index i = 0; i < bound; ++i) in[std::size_t(i)] = true;
  ActiveSetSolution s;
  std::size_t fewest = std::size_t(qp.w.size()) + 1;
  int patience = 3;  // block exchanges without progress before single ones
  const std::size_t limit = 200 + 20 * std::size_t(qp.w.size());
  for (std::size_t step = 0; step < limit; ++step) {
    solve_on(qp, in, s);
    const std::vector<Index> wrong = infeasible(qp, in, s);
    if (wrong.empty()) {
      for (Index i = bound; i < qp.w.size(); ++i) s.p[i] = std::max(0.0, s.p[i]);
      return s;
    }
    if (wrong.size() < fewest) {
      fewest = wrong.size();
      patience = 3;
    } else if (patience > 0) {
      --patience;
    }
    // Murty: exchanging only the last infeasible unknown never cycles.
    const bool block = patience > 0;
    for (std::size_t k = block ? 0 : wrong.size() - 1; k < wrong.size(); ++k) {
      in[std::size_t(wrong[k])] = !in[std::size_t(wrong[k])];
      ++s.changes;
    }
  }
  throw std::domain_error("contact: the active set did not settle; the compliance is too ill-conditioned");
}

}  // namespace teletact::service
