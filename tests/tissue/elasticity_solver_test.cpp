// K u = f on the device against exact answers of the independently assembled K.
#include "service/tissue/elasticity_solver.h"
#include "service/tissue/tissue_model.h"

#include <gtest/gtest.h>

#include <Eigen/SparseCholesky>
#include <cmath>
#include <limits>
#include <random>

#include "service/tissue/elasticity.h"
#include "service/tissue/iterative_compliances.h"
#include "tests/reference/elasticity.h"

namespace teletact::service {
namespace {

using Eigen::VectorXd;

std::shared_ptr<Device> device() {
  static const std::shared_ptr<Device> opened = Device::open();
  return opened;
}

// Uneven lines, stretched elements, odd and even sizes.
TissueGrid uneven_grid() {
  return {graded_coordinates(0, 0.05, 0.015, 0.03, 0.001, 0.006, 1.3), uniform_coordinates(0, 0.02, 17)};
}

Material inclusion(const TissueGrid& grid, double nu, double contrast) {
  Material material{std::vector<double>(grid.elements(), 10e3), nu};
  for (std::size_t j = 0; j + 1 < grid.ny(); ++j)
    for (std::size_t i = 0; i + 1 < grid.nx(); ++i) {
      const double x = grid.x_m[i] - 0.5 * grid.x_m.back(), y = grid.y_m[j] - 0.5 * grid.y_m.back();
      if (std::hypot(x, y) < 0.3 * grid.y_m.back())
        material.youngs_modulus_pa[grid.element(i, j)] *= contrast;
    }
  return material;
}

// Answers with the given unknowns held at the values that u holds there, in extended precision: the operator
// is assembled in it, and a factor in double corrects until nothing is left. The factor's own answer would
// not do: 2e-8 off in deep tissue with nu 0.4999 and a contrast of 100, where the product is 5e-9 off.
class Exact {
 public:
  using Vector = Eigen::Matrix<long double, Eigen::Dynamic, 1>;
  Exact(const TissueGrid& grid, const Material& material, const std::vector<std::uint8_t>& free)
      : free_(free), stiffness_(reference::assemble<long double>(grid, material)) {
    std::vector<std::size_t> held;
    for (std::size_t n = 0; n < free.size(); ++n)
      if (!free[n]) held.push_back(n);
    factor_.compute(reference::with_fixed(reference::assemble(grid, material), held));
  }
  Vector solve(const VectorXd& load, const VectorXd& held) const {
    constexpr double kLeft = 1e-11;  // 1e-18 as a rule, 2e-12 with nu 0.4999 and a contrast of 100
    Vector u = free(held.cast<long double>(), false);
    double last = std::numeric_limits<double>::infinity();
    while (true) {
      const Vector left = free(load.cast<long double>() - stiffness_ * u, true);
      const VectorXd correction = factor_.solve(VectorXd(left.cast<double>()));
      const double size = correction.norm();
      if (!(size < last / 2)) break;
      u += correction.cast<long double>();
      last = size;
    }
    EXPECT_LE(last, kLeft * u.cast<double>().norm()) << "the exact answer is not found";
    return u;
  }
  Vector solve(const VectorXd& load) const { return solve(load, VectorXd::Zero(load.size())); }
  Vector forces(const Vector& u) const { return stiffness_ * u; }
  // Of `u` in the energy norm, relative to that of the truth.
  double error(const VectorXd& u, const Vector& truth) const {
    const Vector e = u.cast<long double>() - truth;
    return static_cast<double>(std::sqrt(e.dot(stiffness_ * e) / truth.dot(stiffness_ * truth)));
  }

 private:
  // u where it is free, or where it is not; zero elsewhere.
  Vector free(Vector u, bool wanted) const {
    for (std::size_t n = 0; n < free_.size(); ++n)
      if ((free_[n] != 0) != wanted) u[static_cast<Eigen::Index>(n)] = 0;
    return u;
  }
  std::vector<std::uint8_t> free_;
  Eigen::SparseMatrix<long double> stiffness_;
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor_;
};

// Unit nodal forces, in y and in x by turns, on `count` surface nodes.
std::vector<double> unit_loads(const TissueGrid& grid, std::size_t count) {
  std::vector<double> loads(count * grid.dofs());
  for (std::size_t q = 0; q < count; ++q)
    loads[q * grid.dofs() + 2 * grid.node((q + 1) * grid.nx() / (count + 1), 0) + (q + 1) % 2] = 1;
  return loads;
}

VectorXd vector(const std::vector<double>& all, std::size_t q, std::size_t dofs) {
  return Eigen::Map<const VectorXd>(all.data() + q * dofs, static_cast<Eigen::Index>(dofs));
}

class InPrecision : public testing::TestWithParam<SolvePrecision> {
 protected:
  void SetUp() override {
    if (GetParam() == SolvePrecision::kDouble && !device()->info().has_double)
      GTEST_SKIP() << "device without double precision";
  }
  ElasticitySolverOptions options() const {
    ElasticitySolverOptions o;
    o.precision = GetParam();
    return o;
  }
  double goal() const { return GetParam() == SolvePrecision::kFloat ? 1e-3 : 1e-7; }
};

TEST_P(InPrecision, AnswersLieWithinTheReportedErrorOfTheExactOnes) {
  const TissueGrid grid = uneven_grid();
  for (const double nu : {0.3, 0.49, 0.495})
    for (const double contrast : {1.0, 100.0}) {
      const Material material = inclusion(grid, nu, contrast);
      ElasticitySolver solver(device(), grid, {}, material, options());
      const std::size_t count = 3;
      const std::vector<double> loads = unit_loads(grid, count);
      std::vector<double> u(count * grid.dofs());
      const SolveReport report = solver.solve(count, loads, u);
      EXPECT_TRUE(report.converged) << report.reason << " nu " << nu << " error " << report.relative_error;
      EXPECT_LE(report.relative_error, goal());
      const Exact exact(grid, material, free_unknowns(grid, {}));
      for (std::size_t q = 0; q < count; ++q) {
        const Exact::Vector truth = exact.solve(vector(loads, q, grid.dofs()));
        EXPECT_LE(exact.error(vector(u, q, grid.dofs()), truth), report.relative_error)
            << "nu " << nu << " contrast " << contrast << " iterations " << report.iterations;
      }
    }
}

TEST_P(InPrecision, PrescribedDisplacementsAndTheirReactionsAreExact) {
  const TissueGrid grid = uneven_grid();
  const Material material = inclusion(grid, 0.49, 5);
  ElasticitySolverOptions wanted = options();
  wanted.prescribed.assign(grid.dofs(), 0);
  std::vector<double> values(grid.dofs(), 0.0);
  for (std::size_t i = 8; i < 18; ++i) {  // a frictionless probe pressed 1 mm
    wanted.prescribed[2 * grid.node(i, 0) + 1] = 1;
    values[2 * grid.node(i, 0) + 1] = 1e-3;
  }
  ElasticitySolver solver(device(), grid, {}, material, wanted);
  std::vector<double> u = values;
  const SolveReport report = solver.solve(1, {}, u);
  EXPECT_TRUE(report.converged) << report.reason << " " << report.relative_error;
  std::vector<std::uint8_t> free = free_unknowns(grid, {});
  for (std::size_t n = 0; n < free.size(); ++n) free[n] = free[n] && !wanted.prescribed[n];
  const Exact exact(grid, material, free);
  const Exact::Vector truth =
      exact.solve(VectorXd::Zero(static_cast<Eigen::Index>(grid.dofs())), vector(values, 0, grid.dofs()));
  EXPECT_LE(exact.error(vector(u, 0, grid.dofs()), truth), report.relative_error);
  const std::vector<double> force = solver.nodal_forces(1, u);
  double total = 0, exact_total = 0;
  const VectorXd exact_force = exact.forces(truth).cast<double>();
  for (std::size_t n = 0; n < free.size(); ++n)
    if (wanted.prescribed[n]) {
      total += force[n];
      exact_total += exact_force[static_cast<Eigen::Index>(n)];
    }
  EXPECT_GT(exact_total, 0);
  EXPECT_NEAR(total / exact_total, 1, goal());
}

TEST_P(InPrecision, WarmStartFromTheAnswerTakesFewerIterations) {
  const TissueGrid grid{uniform_coordinates(0, 0.04, 40), uniform_coordinates(0, 0.04, 40)};  // by multigrid
  ElasticitySolver solver(device(), grid, {}, inclusion(grid, 0.49, 5), options());
  const std::vector<double> loads = unit_loads(grid, 1);
  std::vector<double> u(grid.dofs());
  const SolveReport cold = solver.solve(1, loads, u);
  const std::vector<double> guess = u;
  ElasticitySolver changed(device(), grid, {}, inclusion(grid, 0.49, 5.02), options());
  const SolveReport warm = changed.solve(1, loads, u);
  EXPECT_TRUE(warm.converged) << warm.reason;
  EXPECT_LT(warm.iterations, cold.iterations);
  EXPECT_NE(guess, u);
}

INSTANTIATE_TEST_SUITE_P(Elasticity, InPrecision,
                         testing::Values(SolvePrecision::kFloat, SolvePrecision::kDouble,
                                         SolvePrecision::kRefined),
                         [](const auto& info) {
                           return std::string(info.param == SolvePrecision::kFloat    ? "Float"
                                              : info.param == SolvePrecision::kDouble ? "Double"
                                                                                      : "Refined");
                         });

TEST(ElasticitySolver, RefinementReachesResidualsFarBelowFloat) {
  const TissueGrid grid = uneven_grid();
  ElasticitySolverOptions options;
  options.relative_error = 1e-10;
  ElasticitySolver solver(device(), grid, {}, inclusion(grid, 0.49, 10), options);
  std::vector<double> u(2 * grid.dofs());
  const SolveReport report = solver.solve(2, unit_loads(grid, 2), u);
  EXPECT_TRUE(report.converged) << report.reason;
  EXPECT_LE(report.true_residual, 1e-9);
}

TEST(ElasticitySolver, TinyGridsAreSolvedToTheLastDigit) {
  for (const TissueGrid& grid : {TissueGrid{{0, 0.01}, {0, 0.01}}, TissueGrid{{0, 0.01, 0.013}, {0, 0.002}}})
    for (const double nu : {0.0, 0.3, 0.495}) {
      ElasticitySolverOptions options;
      options.relative_error = 1e-12;
      const Material material{std::vector<double>(grid.elements(), 1e4), nu};
      ElasticitySolver solver(device(), grid, {}, material, options);
      std::vector<double> u(grid.dofs()), load = unit_loads(grid, 1);
      const SolveReport report = solver.solve(1, load, u);
      EXPECT_TRUE(report.converged) << report.reason << " " << report.relative_error;
      const Exact exact(grid, material, free_unknowns(grid, {}));
      const VectorXd right = vector(load, 0, grid.dofs());
      EXPECT_LE(exact.error(vector(u, 0, grid.dofs()), exact.solve(right)), 1e-11) << nu;
    }
}

TEST(ElasticitySolver, DeviceWithoutDoubleIsRefinedFromTheHost) {
  DeviceOptions hidden;
  hidden.hide_double = true;
  const auto single = Device::open(hidden);
  const TissueGrid grid = uneven_grid();
  const std::vector<double> loads = unit_loads(grid, 2);
  std::vector<std::vector<double>> answers;
  for (const auto& on : {single, device()}) {
    ElasticitySolver solver(on, grid, {}, inclusion(grid, 0.495, 100));
    std::vector<double>& u = answers.emplace_back(2 * grid.dofs());
    const SolveReport report = solver.solve(2, loads, u);
    EXPECT_TRUE(report.converged) << report.reason << " " << report.relative_error;
  }
  const VectorXd a = vector(answers[0], 0, 2 * grid.dofs()), b = vector(answers[1], 0, 2 * grid.dofs());
  EXPECT_LE((a - b).lpNorm<Eigen::Infinity>(), 1e-6 * b.lpNorm<Eigen::Infinity>());
  ElasticitySolverOptions in_double;
  in_double.precision = SolvePrecision::kDouble;
  EXPECT_THROW(ElasticitySolver(single, grid, {}, inclusion(grid, 0.495, 100), in_double), DeviceError);
}

TEST(ElasticitySolver, ManyRightHandSidesAnswerAsOneByOne) {
  const TissueGrid grid = uneven_grid();
  ElasticitySolver solver(device(), grid, {}, inclusion(grid, 0.49, 10));
  const std::size_t count = 35;  // more than a batch
  const std::vector<double> loads = unit_loads(grid, count);
  std::vector<double> all(count * grid.dofs());
  EXPECT_TRUE(solver.solve(count, loads, all).converged);
  for (const std::size_t q : {std::size_t{0}, std::size_t{31}, std::size_t{34}}) {
    std::vector<double> one(grid.dofs());
    const std::span<const double> load(loads.data() + q * grid.dofs(), grid.dofs());
    EXPECT_TRUE(solver.solve(1, load, one).converged);
    const VectorXd a = vector(all, q, grid.dofs()), b = vector(one, 0, grid.dofs());
    EXPECT_LE((a - b).lpNorm<Eigen::Infinity>(), 1e-6 * b.lpNorm<Eigen::Infinity>()) << q;
  }
}

// A window of a scene under 32 unit forces, above and within. One sweep there and back over its columns of
// nodes, one behind the other, is the longest chain.
TEST(ElasticitySolver, NarrowGridsAreSolvedInFewLaunchesWhateverTheDevice) {
  const TissueGrid wide{graded_coordinates(0, 0.2, 0.05, 0.15, 0.001, 0.008, 1.3),
                        graded_coordinates(0, 0.04, 0, 0.022, 0.001, 0.002, 1.15)};
  const TissueGrid deep{uniform_coordinates(0, 0.04, 20), uniform_coordinates(0, 0.1, 60)};
  constexpr std::uint64_t kChainOfASolve = 4200;
  for (const TissueGrid& grid : {wide, deep})
    for (const double nu : {0.49, 0.4999}) {
      const Material material = inclusion(grid, nu, 100);
      const std::size_t count = 32;
      std::vector<double> loads(count * grid.dofs());
      for (std::size_t q = 0; q < count; ++q)
        loads[q * grid.dofs() + 2 * grid.node(1 + q % 19, q % 4 * (grid.ny() / 5)) + q % 2] = 1;
      const Exact exact(grid, material, free_unknowns(grid, {}));
      std::vector<Exact::Vector> truths;
      for (std::size_t q = 0; q < count; q += 5) truths.push_back(exact.solve(vector(loads, q, grid.dofs())));
      for (const bool as_gpu : {false, true})
        for (const bool hide_double : {false, true}) {
          DeviceOptions how;
          how.as_gpu = as_gpu, how.hide_double = hide_double;
          const auto device = Device::open(how);
          const ElasticitySolverOptions options = iterative_options(*device, nu);
          ElasticitySolver solver(device, grid, {}, material, options);
          std::vector<double> u(count * grid.dofs());
          solver.nodal_forces(count, u);  // makes the rest
          solver.queue().take_work();
          const SolveReport report = solver.solve(count, loads, u);
          const DeviceWork work = solver.queue().take_work();
          const std::string what =
              std::to_string(nu) + (as_gpu ? " as a GPU" : "") + (hide_double ? " in float" : "");
          EXPECT_TRUE(report.converged) << what << ": " << report.reason;
          const bool in_double = options.precision == SolvePrecision::kDouble;
          EXPECT_LE(work.launches, in_double ? 4u : 16u) << what;
          EXPECT_LE(device->info().gpu && in_double ? work.longest_chain : 0, kChainOfASolve) << what;
          for (std::size_t q = 0; q < count; q += 5)
            EXPECT_LE(exact.error(vector(u, q, grid.dofs()), truths[q / 5]), report.relative_error)
                << what << " " << q;
        }
    }
}

// Float loses the sign of the preconditioner far beyond what is promised: said, and no small error with it.
TEST(ElasticitySolver, NarrowGridsThatFloatCannotSolveSaySo) {
  const TissueGrid grid{uniform_coordinates(0, 0.04, 40), uniform_coordinates(0, 0.05, 5)};
  const Material material = inclusion(grid, 0.49999, 1e4);
  for (const SolvePrecision precision : {SolvePrecision::kFloat, SolvePrecision::kRefined}) {
    ElasticitySolverOptions options;
    options.precision = precision;
    options.max_iterations = 40;
    ElasticitySolver solver(device(), grid, {}, material, options);
    const std::vector<double> loads = unit_loads(grid, 3);
    std::vector<double> u(3 * grid.dofs());
    const SolveReport report = solver.solve(3, loads, u);
    EXPECT_FALSE(report.converged);
    EXPECT_GT(report.relative_error, options.relative_error);
    EXPECT_GT(report.relative_error, 1e-3);
  }
}

TEST(ElasticitySolver, NothingPressedNothingMoves) {
  const TissueGrid grid = uneven_grid();
  ElasticitySolver solver(device(), grid, {}, inclusion(grid, 0.49, 10));
  std::vector<double> u(grid.dofs());
  const SolveReport report = solver.solve(1, {}, u);
  EXPECT_TRUE(report.converged);
  EXPECT_EQ(report.relative_error, 0);
  EXPECT_EQ(u, std::vector<double>(grid.dofs(), 0.0));
}

TEST(ElasticitySolver, RigidMotionOfAllEdgesIsFollowedWithoutForce) {
  const TissueGrid grid = uneven_grid();
  ElasticitySolverOptions options;
  options.prescribed.assign(grid.dofs(), 0);
  std::vector<double> values(grid.dofs());
  const auto rigid = [&](std::size_t i, std::size_t j, int c) {
    return c == 0 ? 1e-3 - 0.1 * grid.y_m[j] : 2e-3 + 0.1 * grid.x_m[i];
  };
  for (std::size_t j = 0; j < grid.ny(); ++j)
    for (std::size_t i = 0; i < grid.nx(); ++i)
      for (int c = 0; c < 2; ++c) {
        const std::size_t dof = 2 * grid.node(i, j) + static_cast<std::size_t>(c);
        options.prescribed[dof] = i == 0 || j == 0 || i + 1 == grid.nx() || j + 1 == grid.ny();
        values[dof] = rigid(i, j, c);
      }
  ElasticitySolver solver(device(), grid, {EdgeSupport::kFree, EdgeSupport::kFree},
                          inclusion(grid, 0.495, 10), options);
  std::vector<double> u(grid.dofs());
  for (std::size_t n = 0; n < u.size(); ++n) u[n] = options.prescribed[n] ? values[n] : 0;
  solver.solve(1, {}, u);
  for (std::size_t n = 0; n < u.size(); ++n) EXPECT_NEAR(u[n], values[n], 1e-9) << n;
}

// Layers and squares of contrast 1000, square and stretched elements: where other preconditioners stop. Under
// a finger, to a force error of 1e-6, the chart counts at most 46 and 74.
TEST(ElasticitySolver, HighContrastTakesFewIterations) {
  if (!device()->queue().supports(Precision::kDouble)) GTEST_SKIP() << "device without double precision";
  constexpr std::size_t kElements = 40;
  for (const auto& [nu, most] : {std::pair{0.499, 60U}, {0.4999, 100U}})
    for (const double stretch : {0.2, 1.0, 5.0})
      for (const std::size_t columns : {4UL, kElements}) {  // of a square: layers where it fills the grid
        const TissueGrid grid{uniform_coordinates(0, 0.06, kElements),
                              uniform_coordinates(0, 0.06 * stretch, kElements)};
        Material material{std::vector<double>(grid.elements(), 10e3), nu};
        for (std::size_t n = 0; n < grid.elements(); ++n)
          if ((n % kElements / columns + n / kElements / 6) % 2) material.youngs_modulus_pa[n] *= 1000;
        ElasticitySolverOptions options;
        options.precision = SolvePrecision::kDouble;
        options.relative_error = 1e-4;  // forces are then within about 1e-6
        for (const ElasticitySolverOptions& o :
             {options, iterative_options(*device(), nu)}) {  // the product's
          ElasticitySolver solver(device(), grid, {}, material, o);
          std::vector<double> load(grid.dofs()), u(grid.dofs());
          for (std::size_t i = 12; i < 28; ++i) load[2 * i + 1] = 1;
          const SolveReport report = solver.solve(1, load, u);
          EXPECT_TRUE(report.converged) << report.reason;
          EXPECT_LE(report.iterations, most) << nu << " " << stretch << " " << columns;
        }
      }
}

TEST(ElasticitySolver, BadInputIsRefusedByName) {
  const TissueGrid grid = uneven_grid();
  const auto message = [](auto&& call) {
    try {
      call();
    } catch (const std::invalid_argument& e) {
      return std::string(e.what());
    }
    return std::string("accepted");
  };
  const Supports floating{EdgeSupport::kFree, EdgeSupport::kFree};
  const auto made = [&](const Supports& supports, double nu) {
    return message([&] { ElasticitySolver(device(), grid, supports, inclusion(grid, nu, 1)); });
  };
  EXPECT_NE(made(floating, 0.49).find("supports"), std::string::npos);
  EXPECT_NE(made({}, 0.5).find("poisson"), std::string::npos);
  ElasticitySolver solver(device(), grid, {}, inclusion(grid, 0.49, 1));
  std::vector<double> u(grid.dofs()), loads(grid.dofs());
  EXPECT_NE(message([&] { solver.solve(2, loads, u); }).find("loads"), std::string::npos);
  loads[3] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE(message([&] { solver.solve(1, loads, u); }).find("loads"), std::string::npos);
}

}  // namespace
}  // namespace teletact::service
