// What iterates of the solid solver are held against: the assembled stiffness in double, and a converged
// answer, checked by its residual.
#pragma once

#include <Eigen/SparseCore>
#include <vector>

#include "bench/suite.h"
#include "bench/suites/solid/cases.h"
#include "service/solid/solid_solver.h"
#include "tests/reference/solid.h"

namespace teletact::bench {

// One problem: under forces, or pushed with a skin that gives way by skin_m_n at each node.
struct SolidTouch {
  SurfaceValues surface;
  bool pushed = false;
  double skin_m_n = 0;
  template <class T>
  service::SolidSolution solve(service::SolidSolver<T>& solver, const service::SolidOptions& options) const {
    if (!pushed) return solver.load(surface.unknowns, surface.values, options);
    return solver.push({surface.unknowns, Eigen::VectorXd::Constant(surface.values.size(), skin_m_n)},
                       surface.values, options);
  }
};

class SolidTruth {
 public:
  static constexpr double kError = 1e-10;  // certified, of the energy norm
  // `k`: the tissue's stiffness, which must outlive this. Throws BenchError where the answer is not K's.
  SolidTruth(const Eigen::SparseMatrix<double>& k, service::SolidSolver<double>& solver,
             const SolidTouch& touch)
      : k_(k), skin_m_n_(touch.pushed ? touch.skin_m_n : 0) {
    const service::SolidSolution s = touch.solve(solver, {.relative_error = kError, .max_iterations = 1000});
    u_ = field(solver), force_n_ = s.force_n;
    energy_ = squared(u_, force_n_);
    Eigen::VectorXd rest = k_ * u_;
    for (Eigen::Index n = 0; n < force_n_.size(); ++n)
      rest[Eigen::Index(touch.surface.unknowns[std::size_t(n)])] -= force_n_[n];
    if (s.reason != service::StopReason::kConverged || !(rest.norm() <= 1e-6 * force_n_.norm()))
      throw BenchError("the solid solver's converged answer does not solve K u = f");
  }
  // |u|^2 of the energy norm.
  double energy() const { return energy_; }
  const Eigen::VectorXd& displacement() const { return u_; }
  // Of the solver's last answer: |e|^2 / |u|^2.
  template <class T>
  double squared_error(const service::SolidSolver<T>& solver, const service::SolidSolution& s) const {
    return squared(field(solver) - u_, s.force_n - force_n_) / energy_;
  }
  double squared_error(const Eigen::VectorXd& u) const {
    return squared(u - u_, force_n_ - force_n_) / energy_;
  }

 private:
  template <class T>
  static Eigen::VectorXd field(const service::SolidSolver<T>& solver) {
    const std::vector<T> u = solver.displacement();
    return Eigen::Map<const Eigen::VectorX<T>>(u.data(), Eigen::Index(u.size())).template cast<double>();
  }
  double squared(const Eigen::VectorXd& u, const Eigen::VectorXd& p) const {
    return u.dot(k_ * u) + skin_m_n_ * p.squaredNorm();
  }
  const Eigen::SparseMatrix<double>& k_;
  double skin_m_n_, energy_ = 0;
  Eigen::VectorXd u_, force_n_;
};

}  // namespace teletact::bench
