#include "bench/suites/solid/truth.h"

#include <algorithm>

namespace teletact::bench {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

Fields rows(const Fields& u, const std::vector<std::size_t>& unknowns) {
  return u(std::vector<Index>(unknowns.begin(), unknowns.end()), Eigen::all);
}

}  // namespace

Fields fields_of(const std::vector<VectorXd>& columns) {
  Fields fields(columns.empty() ? 0 : columns.front().size(), Index(columns.size()));
  for (std::size_t k = 0; k < columns.size(); ++k) fields.col(Index(k)) = columns[k];
  return fields;
}

SolidTruth::SolidTruth(const Eigen::SparseMatrix<double>& k, service::SolidSolver<double>& solver,
                       const SolidTouch& touch)
    : k_(k), touch_(touch) {
  const service::SolidSolution s =
      touch.solve(solver, {.relative_error = kError + solver.rounding(), .max_iterations = 1000});
  u_ = field_of(solver), force_n_ = s.force_n;
  energy_ = inner(u_, touch.surface.values, u_, touch.surface.values)[0];
  VectorXd rest = k_ * u_;
  for (Index n = 0; n < force_n_.size(); ++n)
    rest[Index(touch.surface.unknowns[std::size_t(n)])] -= force_n_[n];
  if (s.reason != service::StopReason::kConverged || !(rest.norm() <= 1e-6 * force_n_.norm()))
    throw BenchError("the solid solver's converged answer does not solve K u = f");
}

VectorXd SolidTruth::squared_errors(const Fields& u) const {
  const Fields e = u.colwise() - u_;
  const VectorXd none = VectorXd::Zero(touch_.surface.values.size());
  return inner(e, none, e, none) / energy_;
}

VectorXd SolidTruth::works(const Fields& u, const Fields& unit) const {
  return inner(u, touch_.surface.values, unit, touch_.unit().surface.values);
}

VectorXd SolidTruth::inner(const Fields& a, const VectorXd& pushed_a, const Fields& b,
                           const VectorXd& pushed_b) const {
  const Fields moved = k_ * b;
  VectorXd sum = a.cwiseProduct(moved).colwise().sum();
  if (!touch_.pushed || touch_.skin_m_n == 0) return sum;
  const auto given = [&](const Fields& u, const VectorXd& pushed) -> Fields {
    return (-rows(u, touch_.surface.unknowns)).colwise() + pushed;
  };
  return sum +
         VectorXd(given(a, pushed_a).cwiseProduct(given(b, pushed_b)).colwise().sum()) / touch_.skin_m_n;
}

SolidTouch settled_touch(service::SolidSolver<double>& solver, const service::SolidGrid& grid, double x_m,
                         double z_m, double indentation_m, double skin_m_n) {
  const SurfaceValues all = paraboloid_push(grid, x_m, z_m, indentation_m);
  const auto touch = [&](const std::vector<Eigen::Index>& active) {
    SolidTouch t{
        .surface = {.unknowns = {}, .values = all.values(active)}, .pushed = true, .skin_m_n = skin_m_n};
    for (const Index n : active) t.surface.unknowns.push_back(all.unknowns[std::size_t(n)]);
    return t;
  };
  return touch(settled(all.values, [&](const std::vector<Eigen::Index>& active) -> Pressed {
    const service::SolidSolution s =
        touch(active).solve(solver, {.relative_error = 1e-8, .max_iterations = 1000});
    const VectorXd u = field_of(solver);
    return {s.force_n, u(std::vector<Index>(all.unknowns.begin(), all.unknowns.end()))};
  }));
}

}  // namespace teletact::bench
