// A pressed patch of solid tissue on the device against a sparse factor, and what it certifies.
#include "service/tissue/solid/solid_solver.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "tests/reference/solid.h"
#include "tests/solver/block_stencil.h"
#include "tests/tissue/solid/solids.h"

namespace teletact::service {
namespace {

// A few nodes around the middle, the components `first` to `last`.
SurfacePatch patch_of(const SolidGrid& grid, std::size_t first, std::size_t last, double skin_m_n) {
  SurfacePatch patch;
  for (std::size_t c = first; c <= last; ++c)
    for (std::size_t k = 3; k < 6; ++k)
      for (std::size_t i = 6; i < 10; ++i) patch.unknowns.push_back(reference::unknown(grid, i, 0, k, c));
  patch.skin_m_n = Eigen::VectorXd::Constant(Eigen::Index(patch.unknowns.size()), skin_m_n);
  return patch;
}

Eigen::VectorXd pushed(const SurfacePatch& patch) {
  Eigen::VectorXd w(patch.skin_m_n.size());
  for (Eigen::Index n = 0; n < w.size(); ++n) w[n] = 1e-3 * (1 - 0.05 * double(n % 5));
  return w;
}

struct Truth {
  Eigen::VectorXd force_n;
  double energy_j = 0;
};
Truth truth(const SolidTissue& tissue, const SurfacePatch& patch, const Eigen::VectorXd& w) {
  Eigen::MatrixXd s = reference::SolidReference(tissue).compliance(patch.unknowns);
  s.diagonal() += patch.skin_m_n;
  Truth t;
  t.force_n = s.ldlt().solve(w);
  t.energy_j = t.force_n.dot(w) / 2;
  return t;
}

class SolidSolverTest : public testing::TestWithParam<double> {};

TEST_P(SolidSolverTest, BoundHoldsAtEveryIteration) {
  const double nu = GetParam();
  const Queue queue = test_device()->queue();
  if (!queue.supports(Precision::kDouble)) GTEST_SKIP() << "the device has no double";
  for (const auto& [contrast, slides] :
       {std::pair{3.0, false}, std::pair{100.0, false}, std::pair{3.0, true}}) {
    SolidTissue tissue = rough(small_grid(), nu, contrast);
    tissue.grid.slides = slides;
    for (const auto& [first, last, skin] :
         {std::tuple{1, 1, 0.0}, std::tuple{1, 1, 2e-3}, std::tuple{0, 2, 0.0}}) {
      const SurfacePatch patch = patch_of(tissue.grid, std::size_t(first), std::size_t(last), skin);
      const Eigen::VectorXd w = pushed(patch);
      const Truth t = truth(tissue, patch, w);
      SolidSolver<double> solver(queue, tissue);
      const SolidSolution s = solver.push(patch, w, {.relative_error = 1e-10});
      EXPECT_EQ(s.reason, StopReason::kConverged);
      EXPECT_LT((s.force_n - t.force_n).norm(), 1e-8 * t.force_n.norm())
          << "nu " << nu << " contrast " << contrast << " components " << first << " to " << last;
      double before = HUGE_VAL;
      for (std::size_t k = 0; k < s.iterations; k += 3) {
        const SolidSolution early = solver.push(patch, w, {.relative_error = 0, .max_iterations = k});
        const double error = early.energy_j - t.energy_j;
        EXPECT_GE(error, -1e-12 * t.energy_j);
        EXPECT_LE(error, early.energy_error_j + 1e-12 * t.energy_j) << "iteration " << k;
        EXPECT_LE(error, before);
        before = error + 1e-12 * t.energy_j;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(PoissonRatios, SolidSolverTest, testing::Values(0.3, 0.49, 0.4999));

// Below the surface the same holds: push, load and what both leave.
TEST(SolidSolver, OnARowItIsTheSparseFactorsAndItsBoundHolds) {
  const Queue queue = test_device()->queue();
  if (!queue.supports(Precision::kDouble)) GTEST_SKIP() << "the device has no double";
  const SolidTissue tissue = rough(small_grid(), 0.49, 30);
  const SolidGrid& grid = tissue.grid;
  const reference::SolidReference reference(tissue);
  SolidSolver<double> solver(queue, tissue);
  for (const std::size_t row : {1U, 4U, 5U}) {
    solver.at(std::make_shared<const SolidRow>(
        SolidRow{row, wide_surface(grid, solver.layers(), 0.49, 0, 0, row)}));
    for (const auto& [first, last, skin] :
         {std::tuple{1, 1, 0.0}, std::tuple{1, 1, 2e-3}, std::tuple{0, 2, 0.0}}) {
      const SurfacePatch patch = patch_of(grid, std::size_t(first), std::size_t(last), skin);
      const Eigen::VectorXd w = pushed(patch);
      std::vector<std::size_t> in_field = patch.unknowns;
      for (std::size_t& unknown : in_field) unknown += 3 * row * grid.columns();
      Eigen::MatrixXd s = reference.compliance(in_field);
      s.diagonal() += patch.skin_m_n;
      const Eigen::VectorXd p = s.ldlt().solve(w);
      const double energy_j = p.dot(w) / 2;
      const SolidSolution all = solver.push(patch, w, {.relative_error = 1e-10});
      EXPECT_EQ(all.reason, StopReason::kConverged);
      EXPECT_LT((all.force_n - p).norm(), 1e-8 * p.norm()) << "row " << row;
      for (std::size_t k = 0; k < all.iterations; k += 4) {
        const SolidSolution early = solver.push(patch, w, {.relative_error = 0, .max_iterations = k});
        EXPECT_GE(early.energy_j - energy_j, -1e-12 * energy_j);
        EXPECT_LE(early.energy_j - energy_j, early.energy_error_j + 1e-12 * energy_j) << "iteration " << k;
      }
      // Pushed or loaded, its excess is what the row moves by beyond the layered tissue.
      Eigen::VectorXd load = Eigen::VectorXd::Zero(Eigen::Index(grid.unknowns()));
      load(in_field) = p;
      const Eigen::VectorXd moved = reference.solve(load).segment(Eigen::Index(3 * row * grid.columns()),
                                                                  Eigen::Index(3 * grid.columns()));
      const Eigen::VectorXd beyond = moved - solver.row()->layered.times(patch.unknowns, p, 0, 3);
      solver.push(patch, w, {.relative_error = 1e-10});
      EXPECT_LT((solver.excess().moved_m - beyond).norm(), 1e-7 * moved.norm());
      const SolidSolution loaded = solver.load(patch.unknowns, p, {.relative_error = 1e-10});
      EXPECT_LT((solver.excess().moved_m - beyond).norm(), 1e-7 * moved.norm());
      EXPECT_NEAR(loaded.energy_j, p.dot(moved(patch.unknowns)) / 2, 1e-8 * loaded.energy_j);
    }
  }
}

TEST(SolidSolver, LayeredTissueTakesNoIteration) {
  for (const bool slides : {false, true}) {
    SolidGrid grid = small_grid();
    grid.slides = slides;
    const SolidTissue tissue =
        solid(grid, 0.49, [](double, double y, double) { return y < 0.008 ? 1e4 : 5e4; });
    const SurfacePatch patch = patch_of(grid, 1, 1, 0);
    const Eigen::VectorXd w = pushed(patch);
    SolidSolver<float> solver(test_device()->queue(), tissue);
    const SolidSolution s = solver.push(patch, w, {.relative_error = 1e-3});
    EXPECT_EQ(s.iterations, 0u);
    const Truth t = truth(tissue, patch, w);
    EXPECT_LT((s.force_n - t.force_n).norm(), 1e-5 * t.force_n.norm());
  }
}

// On a processor and as on a GPU, whose solution may lie in either of two arrays.
TEST(SolidSolver, FromTheLastSolutionItIsTheSameInFewerIterations) {
  const Queue queue = test_device()->queue();
  if (!queue.supports(Precision::kDouble)) GTEST_SKIP() << "the device has no double";
  for (const Queue& on : {queue, test_gpu()->queue()}) {
    const SolidTissue tissue = rough(small_grid(), 0.49, 10);
    SolidTissue other = tissue;
    for (std::size_t e = 0; e < other.youngs_modulus_pa.size(); e += 3) other.youngs_modulus_pa[e] *= 1.01;
    const SurfacePatch patch = patch_of(tissue.grid, 1, 1, 2e-3);
    const Eigen::VectorXd w = pushed(patch),
                          tilted = w.array() * (1 + 0.02 * Eigen::ArrayXd::LinSpaced(w.size(), -1, 1));
    const SolidOptions options{.relative_error = 1e-5, .from_last = true};
    SolidSolver<double> solver(on, tissue);
    const SolidSolution first = solver.push(patch, w, options);
    solver.use(std::make_shared<const SolidModulus<double>>(
        on, other, beside(other, solver.layers().youngs_modulus_pa)));
    const SolidSolution after = solver.push(patch, tilted, options);
    const Truth t = truth(other, patch, tilted);
    EXPECT_EQ(after.reason, StopReason::kConverged);
    EXPECT_LT(after.iterations + 3, first.iterations);
    EXPECT_LT((after.force_n - t.force_n).norm(), 1e-4 * t.force_n.norm());
    EXPECT_GE(after.energy_j, t.energy_j * (1 - 1e-12));
    EXPECT_LE(after.energy_j - t.energy_j, after.energy_error_j + 1e-12 * t.energy_j);
    solver.forget_last();
    EXPECT_GT(solver.push(patch, tilted, options).iterations, after.iterations + 3);
    SolidOptions least = options;
    least.min_iterations = 2;
    EXPECT_GE(solver.push(patch, tilted, least).iterations, 2U);
  }
}

TEST(SolidSolver, UnderALoadItIsTheSparseFactors) {
  const Queue queue = test_device()->queue();
  if (!queue.supports(Precision::kDouble)) GTEST_SKIP() << "the device has no double";
  const SolidTissue tissue = rough(small_grid(), 0.49, 30);
  const SurfacePatch patch = patch_of(tissue.grid, 0, 2, 0);
  const Eigen::VectorXd p = pushed(patch);
  const Eigen::VectorXd u = reference::SolidReference(tissue).compliance(patch.unknowns) * p;
  SolidSolver<double> solver(queue, tissue);
  const SolidSolution s = solver.load(patch.unknowns, p, {.relative_error = 1e-9});
  EXPECT_LT((s.displacement_m - u).norm(), 1e-8 * u.norm());
  for (std::size_t k = 0; k < s.iterations; k += 4) {
    const SolidSolution early = solver.load(patch.unknowns, p, {.relative_error = 0, .max_iterations = k});
    const double error = u.dot(p) / 2 - early.energy_j;
    EXPECT_GE(error, -1e-12 * early.energy_j);
    EXPECT_LE(error, early.energy_error_j + 1e-12 * early.energy_j) << "iteration " << k;
  }
}

// On the surface and below it, as the device does it and as a GPU does.
TEST(SolidSolver, InFloatItIsTheSparseFactorsToRounding) {
  const SolidTissue tissue = rough(small_grid(), 0.49, 10);
  const reference::SolidReference reference(tissue);
  for (const Queue& queue : {test_device()->queue(), test_gpu()->queue()}) {
    SolidSolver<float> solver(queue, tissue);
    for (const std::size_t row : {0U, 4U})
      for (const auto& [first, last] : {std::pair{1, 1}, std::pair{0, 2}}) {
        solver.at(std::make_shared<const SolidRow>(
            SolidRow{row, wide_surface(tissue.grid, solver.layers(), 0.49, 0, 0, row)}));
        const SurfacePatch patch = patch_of(tissue.grid, std::size_t(first), std::size_t(last), 1e-3);
        const Eigen::VectorXd w = pushed(patch);
        std::vector<std::size_t> in_field = patch.unknowns;
        for (std::size_t& unknown : in_field) unknown += 3 * row * tissue.grid.columns();
        Eigen::MatrixXd s = reference.compliance(in_field);
        s.diagonal() += patch.skin_m_n;
        const Eigen::VectorXd p = s.ldlt().solve(w);
        const SolidSolution found = solver.push(patch, w, {.relative_error = 1e-4});
        EXPECT_EQ(found.reason, StopReason::kConverged);
        EXPECT_LT((found.force_n - p).norm(), 1e-4 * p.norm()) << "row " << row << " components " << first;
      }
  }
}

// In float the stiffness itself is rounded, and the bound knows nothing of it.
TEST(SolidSolver, StatesWhatRoundingMayLeave) {
  for (const double nu : {0.3, 0.49, 0.4999}) {
    const SolidTissue tissue = rough(small_grid(), nu, 10);
    const SurfacePatch patch = patch_of(tissue.grid, 1, 1, 0);
    const Eigen::VectorXd w = pushed(patch);
    const Truth t = truth(tissue, patch, w);
    SolidSolver<float> solver(test_device()->queue(), tissue);
    const SolidSolution s = solver.push(patch, w, {.relative_error = 1e-7});
    EXPECT_NE(s.reason, StopReason::kConverged) << nu << ": float cannot";
    EXPECT_LT(s.iterations, 80u) << "in vain";
    // |p - truth| in the norm of the compliance is part of the error that is stated.
    Eigen::MatrixXd compliance = reference::SolidReference(tissue).compliance(patch.unknowns);
    const Eigen::VectorXd off = s.force_n - t.force_n;
    const double error = std::sqrt(off.dot(compliance * off) / (2 * t.energy_j));
    EXPECT_LE(error, s.relative_error()) << nu;
    EXPECT_GT(s.relative_error(), 1e-7) << nu;
  }
}

// Launches, copies and waits of an iteration beyond the first ones.
DeviceWork work_of_an_iteration(const Queue& queue, SolidSolver<double>& solver, const SurfacePatch& patch) {
  constexpr std::size_t kMore = 4;
  const auto solve = [&](std::size_t iterations) {
    queue.take_work();
    solver.push(patch, pushed(patch), {.relative_error = 0, .max_iterations = iterations});
    return queue.take_work();
  };
  const DeviceWork few = solve(2);
  DeviceWork more = solve(2 + kMore);
  more.launches = (more.launches - few.launches) / kMore, more.copies = (more.copies - few.copies) / kMore;
  more.waits = (more.waits - few.waits) / kMore, more.looks = (more.looks - few.looks) / kMore;
  return more;
}

TEST(SolidSolver, AnIterationIsFewLaunchesAndOnAGpuNoWait) {
  const SolidTissue tissue = rough(small_grid(), 0.49, 10);
  const SurfacePatch patch = patch_of(tissue.grid, 0, 2, 0);
  const Queue queue = test_device()->queue(), gpu = test_gpu()->queue();
  if (!queue.supports(Precision::kDouble)) GTEST_SKIP() << "the device has no double";
  SolidSolver<double> solver(queue, tissue), ahead(gpu, tissue);
  const DeviceWork here = work_of_an_iteration(queue, solver, patch),
                   there = work_of_an_iteration(gpu, ahead, patch);
  EXPECT_LE(there.launches, 8u);
  EXPECT_EQ(there.waits, 0u);
  EXPECT_EQ(there.copies, 1u) << "the scalars, on their way";
  EXPECT_LE(there.longest_chain, 1024u);
  if (queue.info().gpu) return;
  EXPECT_LE(here.launches, 12u);
  EXPECT_EQ(here.waits, 1u);
  EXPECT_EQ(here.copies, 0u);
  EXPECT_LE(here.longest_chain, 1024u);
}

// The ways of a GPU, on the surface and below it, pushed and loaded; and that it goes ahead of the host
// changes nothing: with somebody watching it does not.
TEST(SolidSolver, AsAGpuDoesItIsTheSame) {
  const Queue queue = test_device()->queue(), gpu = test_gpu()->queue();
  if (!queue.supports(Precision::kDouble)) GTEST_SKIP() << "the device has no double";
  const SolidTissue tissue = rough(small_grid(), 0.49, 30);
  SolidSolver<double> here(queue, tissue), there(gpu, tissue);
  for (const std::size_t row : {0U, 4U}) {
    const auto at = std::make_shared<const SolidRow>(
        SolidRow{row, wide_surface(tissue.grid, here.layers(), 0.49, 0, 0, row)});
    here.at(at), there.at(at);
    const SurfacePatch patch = patch_of(tissue.grid, 0, 2, 1e-3);
    const Eigen::VectorXd w = pushed(patch);
    for (const bool push : {true, false}) {
      const auto solve = [&](SolidSolver<double>& solver, const SolidOptions& options) {
        return push ? solver.push(patch, w, options) : solver.load(patch.unknowns, w, options);
      };
      SolidOptions options{.relative_error = 1e-9};
      const SolidSolution a = solve(here, options), b = solve(there, options);
      const RowExcess left = here.excess(), left_there = there.excess();
      EXPECT_EQ(a.iterations, b.iterations);
      EXPECT_EQ(b.reason, StopReason::kConverged);
      EXPECT_LT((a.force_n - b.force_n).norm(), 1e-10 * a.force_n.norm());
      EXPECT_LT((a.displacement_m - b.displacement_m).norm(), 1e-10 * a.displacement_m.norm());
      EXPECT_NEAR(b.energy_error_j, a.energy_error_j, 1e-3 * a.energy_error_j);
      EXPECT_LT((left.moved_m - left_there.moved_m).norm(), 1e-8 * left.moved_m.norm());
      for (const std::size_t iterations : {3U, 4U}) {  // either of what it keeps two of
        options.max_iterations = iterations;
        const SolidSolution early = solve(there, options);
        const std::vector<double> field = there.displacement();
        options.watch = [](const SolidSolution&) { return true; };
        const SolidSolution watched = solve(there, options);
        options.watch = {};
        EXPECT_EQ(early.iterations, iterations);
        EXPECT_EQ(early.energy_error_j, watched.energy_error_j);
        EXPECT_EQ(early.force_n, watched.force_n);
        EXPECT_EQ(field, there.displacement());
      }
    }
  }
}

TEST(HexahedronStiffness, FallsApartByParity) {
  const HexahedronMatrix k = hexahedron_stiffness(0.0013, 0.0017, 0.0021, 0.49);
  const std::array<double, 72> blocks = parity_blocks(k);
  HexahedronMatrix sums = HexahedronMatrix::Zero(),
                   by_parity = HexahedronMatrix::Zero();  // [8 component + parity]
  for (int p = 0; p < 3; ++p)
    for (int s = 0; s < 8; ++s) {
      for (int corner = 0; corner < 8; ++corner) {
        const std::array<bool, 3> far{(corner & 1) != 0, (corner & 4) != 0, (corner & 2) != 0};
        double& sign = sums(8 * p + s, 3 * corner + p) = 1;
        for (int q = 0; q < 3; ++q)
          if ((s >> q & 1) != 0 && !far[std::size_t(q)]) sign = -sign;
      }
      for (int q = 0; q < 3; ++q)
        by_parity(8 * p + (s ^ 1 << p), 8 * q + (s ^ 1 << q)) = blocks[std::size_t(9 * s + 3 * p + q)];
    }
  EXPECT_LT((sums.transpose() * by_parity * sums - k).norm(), 1e-15 * k.norm());
  // What a processor's kernel leaves out.
  EXPECT_EQ((by_parity.array().abs() > 1e-15 * k.norm()).count(), 39);
}

// A processor multiplies by parity, in several blocks of rows here; a GPU by the whole matrix.
TEST(SolidSolver, ByParityItIsTheWholeMatrix) {
  const Queue queue = test_device()->queue(), gpu = test_gpu()->queue();
  if (!queue.supports(Precision::kDouble)) GTEST_SKIP() << "the device has no double";
  const SolidTissue tissue = rough({16, 16, 0.002, 0.0025, graded_rows(0.020, 10, 1.1)}, 0.49, 30);
  const std::vector<std::size_t> unknowns = patch_of(tissue.grid, 0, 2, 0).unknowns;
  const Eigen::VectorXd p = Eigen::VectorXd::Ones(Eigen::Index(unknowns.size()));
  const auto displacement = [&](const Queue& on) -> Eigen::VectorXd {
    SolidSolver<double> solver(on, tissue);
    solver.load(unknowns, p, {.relative_error = 0, .max_iterations = 4});
    const std::vector<double> u = solver.displacement();
    return Eigen::Map<const Eigen::VectorXd>(u.data(), Eigen::Index(u.size()));
  };
  const Eigen::VectorXd u = displacement(gpu);
  EXPECT_LT((displacement(queue) - u).norm(), 1e-13 * u.norm());
}

}  // namespace
}  // namespace teletact::service
