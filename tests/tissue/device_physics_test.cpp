// The device's elasticity against closed forms, as plane_strain_test does for the reference.
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <memory>
#include <span>
#include <vector>

#include "service/tissue/elasticity_solver.h"
#include "tests/reference/elasticity.h"
#include "tests/tissue/fields.h"
#include "tests/tissue/tissue_cases.h"

namespace teletact {
namespace {

using Eigen::Index;
using Eigen::Vector2d;
using Eigen::VectorXd;
using service::EdgeSupport;
using service::ElasticitySolver;
using service::ElasticitySolverOptions;
using service::Material;
using service::SolvePrecision;
using service::Supports;
using service::TissueGrid;
using tests::Manufactured;
using tests::nodal;

std::shared_ptr<service::Device> device() {
  static const std::shared_ptr<service::Device> opened = service::Device::open();
  return opened;
}

constexpr Supports kAllFixed{EdgeSupport::kFixed, EdgeSupport::kFixed, EdgeSupport::kFixed,
                             EdgeSupport::kFixed};

std::span<const double> span(const VectorXd& v) {
  return {v.data(), std::size_t(v.size())};
}

VectorXd forces(ElasticitySolver& solver, const VectorXd& u) {
  const std::vector<double> f = solver.nodal_forces(1, span(u));
  return Eigen::Map<const VectorXd>(f.data(), Index(f.size()));
}

TEST(DevicePhysics, IsSymmetricAndKeepsRigidMotionsFree) {
  const TissueGrid grid = tests::uneven_grid(13, 9);
  const Material material = tests::scattered(grid, 100, 0.495);
  ElasticitySolver solver(device(), grid, Supports{}, material);
  const double scale = reference::assemble(grid, material).diagonal().maxCoeff();
  EXPECT_LE(forces(solver, nodal(grid, [](double, double) { return Vector2d(1, 0); })).cwiseAbs().maxCoeff(),
            1e-13 * scale);
  EXPECT_LE(forces(solver, nodal(grid, [](double, double) { return Vector2d(0, 1); })).cwiseAbs().maxCoeff(),
            1e-13 * scale);
  EXPECT_LE(forces(solver, nodal(grid, [](double x, double y) { return Vector2d(-100 * y, 100 * x); }))
                .cwiseAbs()
                .maxCoeff(),
            1e-13 * scale);
  const VectorXd a = VectorXd::Random(Index(grid.dofs())), b = VectorXd::Random(Index(grid.dofs()));
  const VectorXd ka = forces(solver, a), kb = forces(solver, b);
  EXPECT_NEAR(a.dot(kb), b.dot(ka), 1e-12 * a.norm() * kb.norm());
}

TEST(DevicePhysics, PatchTestWithPrescribedEdges) {
  const TissueGrid grid = tests::uneven_grid(14, 11);
  const VectorXd exact = nodal(grid, [](double x, double y) {
    return Vector2d(1e-3 + 0.02 * x - 0.03 * y, -2e-3 + 0.01 * x + 0.05 * y);
  });
  ElasticitySolverOptions options;
  options.prescribed.assign(grid.dofs(), 0);
  for (std::size_t dof : reference::fixed_dofs(grid, kAllFixed)) options.prescribed[dof] = 1;
  const Supports none{EdgeSupport::kFree, EdgeSupport::kFree, EdgeSupport::kFree, EdgeSupport::kFree};
  for (double nu : {0.0, 0.3, 0.49, 0.4999}) {
    ElasticitySolver solver(device(), grid, none, tests::inclusion(grid, 1, nu), options);
    std::vector<double> u(grid.dofs(), 0.0);
    for (std::size_t n = 0; n < u.size(); ++n)
      if (options.prescribed[n]) u[n] = exact[Index(n)];
    const auto report = solver.solve(1, {}, u);
    EXPECT_TRUE(report.converged) << report.reason;
    const VectorXd error = Eigen::Map<const VectorXd>(u.data(), Index(u.size())) - exact;
    EXPECT_LE(error.cwiseAbs().maxCoeff(), 1e-6 * exact.cwiseAbs().maxCoeff()) << nu;
  }
}

double manufactured_error(std::size_t cells, double nu, SolvePrecision precision) {
  const Manufactured exact(1e4, nu);
  const TissueGrid grid = tests::uniform_grid(cells + 1, cells + 1, exact.length / double(cells));
  ElasticitySolverOptions options;
  options.precision = precision;
  ElasticitySolver solver(device(), grid, kAllFixed, tests::inclusion(grid, 1, nu), options);
  const VectorXd load = reference::body_load(grid, [&](double x, double y) { return exact.force(x, y); });
  std::vector<double> u(grid.dofs(), 0.0);
  EXPECT_TRUE(solver.solve(1, span(load), u).converged);
  const VectorXd field = nodal(grid, [&](double x, double y) { return exact.displacement(x, y); });
  return (Eigen::Map<const VectorXd>(u.data(), Index(u.size())) - field).cwiseAbs().maxCoeff() / 1e-3;
}

TEST(DevicePhysics, ManufacturedSolutionConvergesAtSecondOrder) {
  for (double nu : {0.3, 0.45}) {
    const double coarse = manufactured_error(12, nu, SolvePrecision::kRefined);
    const double middle = manufactured_error(24, nu, SolvePrecision::kRefined);
    const double fine = manufactured_error(48, nu, SolvePrecision::kRefined);
    EXPECT_NEAR(std::log2(coarse / middle), 2, 0.15) << nu;
    EXPECT_NEAR(std::log2(middle / fine), 2, 0.15) << nu;
    EXPECT_NEAR(manufactured_error(24, nu, SolvePrecision::kFloat) / middle, 1, 0.02) << nu;
  }
}

// A column pushed sideways at its top bends like a beam, whose deflection goes with (1 - nu^2): no locking.
TEST(DevicePhysics, NoLockingNearIncompressibility) {
  const TissueGrid grid = tests::uniform_grid(9, 33);
  const auto deflection = [&](double nu) {
    ElasticitySolver solver(device(), grid, Supports{}, tests::inclusion(grid, 1, nu));
    std::vector<double> load(grid.dofs(), 0.0), u(grid.dofs(), 0.0);
    for (std::size_t i = 0; i < grid.nx(); ++i) load[2 * grid.node(i, 0)] = 1.0 / double(grid.nx());
    EXPECT_TRUE(solver.solve(1, load, u).converged) << nu;
    return u[2 * grid.node(4, 0)];
  };
  EXPECT_NEAR(deflection(0.4999) / deflection(0.3), (1 - 0.4999 * 0.4999) / (1 - 0.3 * 0.3), 0.05);
}

}  // namespace
}  // namespace teletact
