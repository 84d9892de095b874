// What iterates of the solid solver are held against: the assembled stiffness in double, and a converged
// answer, checked by its residual.
#pragma once

#include <Eigen/SparseCore>
#include <cmath>
#include <vector>

#include "bench/solid_blocks.h"
#include "bench/suite.h"
#include "service/tissue/solid/solid_solver.h"
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
  // The same nodes pushed by 1 m: a force is the work of the one's field in the other's.
  SolidTouch unit() const {
    return {{surface.unknowns, Eigen::VectorXd::Ones(surface.values.size())}, pushed, skin_m_n};
  }
};

// Displacements of the whole block, one a column.
using Fields = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
Fields fields_of(const std::vector<Eigen::VectorXd>& columns);
template <class T>
Eigen::VectorXd field_of(const service::SolidSolver<T>& solver) {
  const std::vector<T> u = solver.displacement();
  return Eigen::Map<const Eigen::VectorX<T>>(u.data(), Eigen::Index(u.size())).template cast<double>();
}

class SolidTruth {
 public:
  static constexpr double kError = 1e-10;  // certified, of the energy norm
  // `k`: the tissue's stiffness, which must outlive this. Throws BenchError where the answer is not K's.
  SolidTruth(const Eigen::SparseMatrix<double>& k, service::SolidSolver<double>&, const SolidTouch&);
  double energy() const { return energy_; }  // |u|^2 of the energy norm
  const Eigen::VectorXd& displacement() const { return u_; }
  const Eigen::VectorXd& force_n() const { return force_n_; }
  // |e|^2 / |u|^2 of each.
  Eigen::VectorXd squared_errors(const Fields& u) const;
  double squared_error(const Eigen::VectorXd& u) const { return squared_errors(u)[0]; }
  // Each field's work in that of the unit push on the same nodes: where both are the tissue's, the force.
  Eigen::VectorXd works(const Fields& u, const Fields& unit) const;

 private:
  // Skins give way by what is left of the push.
  Eigen::VectorXd inner(const Fields& a, const Eigen::VectorXd& pushed_a, const Fields& b,
                        const Eigen::VectorXd& pushed_b) const;
  const Eigen::SparseMatrix<double>& k_;
  const SolidTouch touch_;
  double energy_ = 0;
  Eigen::VectorXd u_, force_n_;
};

// Under a paraboloid of 8 mm, `indentation_m` deep at (x, z) from the middle, with that skin.
SolidTouch settled_touch(service::SolidSolver<double>&, const service::SolidGrid&, double x_m, double z_m,
                         double indentation_m, double skin_m_n);

}  // namespace teletact::bench
