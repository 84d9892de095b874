#include "service/tissue/column_condensation.h"

#include <gtest/gtest.h>

#include <Eigen/SparseCholesky>
#include <numeric>
#include <random>

#include "service/tissue/tissue_model.h"
#include "tests/reference/elasticity.h"
#include "tests/tissue/tissue_cases.h"

namespace teletact {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using service::ColumnRange;
using service::CondensedSides;
using service::Layers;
using service::Material;
using service::Supports;
using service::TissueGrid;
using service::TissueModel;
using service::TouchedNodes;

// Of the touchable columns of a row, by a sparse factor of the reference assembly.
MatrixXd reference_compliance(const TissueModel& model, std::size_t row) {
  const TissueGrid& grid = model.problem().grid;
  const auto k = reference::with_fixed(reference::assemble(grid, model.problem().material),
                                       reference::fixed_dofs(grid, model.problem().supports));
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor(k);
  const ColumnRange columns = model.problem().touchable;
  const Index first = Index(2 * grid.node(columns.first, row));
  const Index size = Index(2 * (columns.last - columns.first + 1));
  MatrixXd s(size, size);
  for (Index b = 0; b < size; ++b)
    s.col(b) = factor.solve(VectorXd::Unit(k.rows(), first + b)).segment(first, size);
  return s;
}

MatrixXd compliance(const TissueModel& model, std::size_t row, service::SolveReport* report = nullptr) {
  const ColumnRange columns = model.problem().touchable;
  std::vector<std::size_t> nodes(columns.last - columns.first + 1);
  std::iota(nodes.begin(), nodes.end(), columns.first);
  return model.compliance(row)->among(nodes, report);
}

// The columns [first, end) of elements times a factor of 0.1 to 10 each.
Material changed(const TissueGrid& grid, Material material, std::size_t first, std::size_t end,
                 std::mt19937& random) {
  std::uniform_real_distribution<double> exponent(-1, 1);
  for (std::size_t j = 0; j + 1 < grid.ny(); ++j)
    for (std::size_t i = first; i < end; ++i)
      material.youngs_modulus_pa[grid.element(i, j)] *= std::pow(10, exponent(random));
  return material;
}

// Ranges of element columns that change: none, all, one, at the edges, and any.
std::vector<std::pair<std::size_t, std::size_t>> ranges(std::size_t columns, std::mt19937& random) {
  std::vector<std::pair<std::size_t, std::size_t>> all{
      {0, 0}, {0, columns}, {0, 1}, {columns - 1, columns}, {columns / 2, columns / 2 + 1}};
  for (int k = 0; k < 6; ++k) {
    std::uniform_int_distribution<std::size_t> any(0, columns);
    all.emplace_back(std::minmax({any(random), any(random)}));
  }
  return all;
}

TEST(ColumnCondensation, ChangedModelIsTheModelMadeAnewToTheBit) {
  std::mt19937 random(7);
  const TissueGrid grid = tests::uneven_grid(29, 9);
  const service::TissueModelOptions options{
      .touch_begin_m = grid.x_m[6], .touch_end_m = grid.x_m[23], .will_change = true};
  for (const double nu : {0.3, 0.49, 0.4999})
    for (const double contrast : {1.0, 100.0, 1e6})
      for (const auto& [first, end] : ranges(grid.nx() - 1, random)) {
        const TissueModel before(grid, tests::scattered(grid, contrast, nu), Supports{}, options);
        before.compliance(3);
        const Material now = changed(grid, before.problem().material, first, end, random);
        const TissueModel anew(grid, now, Supports{}, options),
            model(grid, now, Supports{}, options, &before);
        for (const std::size_t row : {0, 3}) {
          service::SolveReport report;
          const MatrixXd s = compliance(model, row, &report);
          EXPECT_EQ((s - compliance(anew, row)).cwiseAbs().maxCoeff(), 0)
              << "columns " << first << " to " << end << " row " << row << " nu " << nu;
          const MatrixXd exact = reference_compliance(model, row);
          EXPECT_LE((s - exact).cwiseAbs().maxCoeff(), report.relative_error * exact.diagonal().maxCoeff())
              << "columns " << first << " to " << end << " row " << row << " nu " << nu << " contrast "
              << contrast;
        }
      }
}

// One change after the other, each model made from the one before.
TEST(ColumnCondensation, ManyChangesDoNotAddUp) {
  std::mt19937 random(11);
  const TissueGrid grid = tests::uneven_grid(29, 9);
  const service::TissueModelOptions options{.will_change = true};
  auto model = std::make_unique<TissueModel>(grid, tests::scattered(grid, 100, 0.49), Supports{}, options);
  for (const auto& [first, end] : ranges(grid.nx() - 1, random)) {
    model = std::make_unique<TissueModel>(grid, changed(grid, model->problem().material, first, end, random),
                                          Supports{}, options, model.get());
    const TissueModel anew(grid, model->problem().material, Supports{}, {});
    EXPECT_EQ((compliance(*model, 0) - compliance(anew, 0)).cwiseAbs().maxCoeff(), 0);
  }
}

TEST(ColumnCondensation, ModelOfOtherTissueIsNotTakenOver) {
  const TissueGrid grid = tests::uneven_grid(29, 9);
  const Material material = tests::scattered(grid, 10, 0.49);
  const service::TissueModelOptions options{.will_change = true};
  TissueGrid other_grid = grid;
  other_grid.x_m.back() += 1e-4;
  Material other_nu = material;
  other_nu.poisson_ratio = 0.48;
  Supports other_supports;
  other_supports.left = service::EdgeSupport::kFixed;
  service::TissueModelOptions narrow = options;
  narrow.touch_begin_m = grid.x_m[4], narrow.touch_end_m = grid.x_m[11];
  const TissueModel before[] = {{other_grid, material, {}, options},
                                {grid, other_nu, {}, options},
                                {grid, material, other_supports, options},
                                {grid, material, {}, narrow}};
  const TissueModel anew(grid, material, {}, options);
  for (const TissueModel& other : before) {
    const TissueModel model(grid, material, {}, options, &other);
    EXPECT_EQ((compliance(model, 0) - compliance(anew, 0)).cwiseAbs().maxCoeff(), 0);
  }
  // Held otherwise where the same columns are touched.
  const TissueModel held(grid, material, other_supports, narrow), free(grid, material, {}, narrow),
      after(grid, material, {}, narrow, &held);
  EXPECT_EQ((compliance(after, 0) - compliance(free, 0)).cwiseAbs().maxCoeff(), 0);
}

TEST(ColumnCondensation, WhatDidNotChangeIsTakenOver) {
  std::mt19937 random(3);
  const TissueGrid grid = tests::uneven_grid(29, 9);
  const Material before = tests::scattered(grid, 10, 0.49);
  const service::LayeredStiffness columns(grid, before, {}, Layers::kColumns);
  const TouchedNodes touched{2, {4, 24}};  // seam at 14; halfway at 7 and 21
  const CondensedSides sides = condensed_sides(columns, touched, {});
  const auto kept = [&](std::size_t first, std::size_t end) {
    const CondensedSides same = unchanged(sides, grid, before, changed(grid, before, first, end, random));
    EXPECT_TRUE(!same.whole[0] || same.whole[0] == sides.whole[0]);
    EXPECT_TRUE(!same.whole[1] || same.whole[1] == sides.whole[1]);
    return std::array{same.halfway[0] != nullptr, same.whole[0] != nullptr, same.whole[1] != nullptr,
                      same.halfway[1] != nullptr};
  };
  EXPECT_EQ(kept(0, 0), (std::array{true, true, true, true}));
  EXPECT_EQ(kept(0, 28), (std::array{false, false, false, false}));
  EXPECT_EQ(kept(14, 28), (std::array{true, true, false, false}));
  EXPECT_EQ(kept(14, 21), (std::array{true, true, false, true}));
  EXPECT_EQ(kept(13, 14), (std::array{true, false, true, true}));
  EXPECT_EQ(kept(0, 14), (std::array{false, false, true, true}));
  EXPECT_EQ(kept(7, 21), (std::array{true, false, false, true}));
  EXPECT_EQ(kept(6, 22), (std::array{false, false, false, false}));
}

// Whatever the shape; the elimination by rows is held to what it states, this to what double precision
// allows.
TEST(ColumnCondensation, EqualsSparseFactorNearIncompressibility) {
  for (const auto& [nx, ny] : {std::pair{2, 2}, {3, 12}, {17, 9}, {41, 3}, {9, 26}})
    for (const auto& [nu, bound] : {std::pair{0.3, 5e-12}, {0.495, 5e-11}, {0.4999, 5e-10}}) {
      const TissueGrid grid = tests::uneven_grid(std::size_t(nx), std::size_t(ny));
      const TissueModel model(grid, tests::scattered(grid, 10, nu), {}, {});
      const MatrixXd exact = reference_compliance(model, 0);
      const service::LayeredStiffness columns(grid, model.problem().material, {}, Layers::kColumns);
      const TouchedNodes touched{0, model.problem().touchable};
      const MatrixXd s =
          joined(condensed_sides(columns, touched, {}), touched).selfadjointView<Eigen::Lower>();
      const double error = (s - exact).cwiseAbs().maxCoeff() / exact.diagonal().maxCoeff();
      EXPECT_LE(error, bound) << nx << "x" << ny << " nu " << nu;
    }
}

}  // namespace
}  // namespace teletact
