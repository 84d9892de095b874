// Every multigrid kernel against plain double loops (dense matrices), and the cycle's symmetry. One file: all
// cases need the same levels and their dense twins.
#include "service/solver/multigrid.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <limits>

#include "service/device/cancellation.h"
#include "service/solver/linear_operator.h"
#include "service/solver/smoother.h"
#include "tests/solver/block_stencil.h"
#include "tests/solver/levels_on_device.h"

namespace teletact::service {
namespace {

using Eigen::MatrixXd;

// Uneven node lines in [0, count).
std::vector<double> uneven(std::size_t count, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(0, 0.6);
  std::vector<double> lines;
  for (std::size_t i = 0; i < count; ++i) lines.push_back(static_cast<double>(i) + uniform(random));
  return lines;
}

template <class T>
class Multigrid_ : public testing::Test {
 protected:
  void SetUp() override {
    if (!queue_.supports(precision_of<T>)) GTEST_SKIP() << "device without double precision";
  }
  static double eps() { return std::numeric_limits<T>::epsilon(); }
  Queue queue_ = test_device()->queue();
};
using Types = testing::Types<float, double>;
TYPED_TEST_SUITE(Multigrid_, Types);

double largest(const MatrixXd& m) {
  return m.allFinite() ? m.template lpNorm<Eigen::Infinity>() : 1e300;
}

// Nodes of a work item: a GPU's and a processor's.
constexpr std::size_t kWidths[] = {1, 8};

NodeLines even(std::size_t nx, std::size_t ny) {
  NodeLines lines;
  for (std::size_t i = 0; i < nx; ++i) lines.x.push_back(static_cast<double>(i));
  for (std::size_t j = 0; j < ny; ++j) lines.y.push_back(static_cast<double>(j));
  return lines;
}

TYPED_TEST(Multigrid_, ProductAndResidualMatchPlainLoops) {
  using T = TypeParam;
  for (const auto& [nx, ny] : {std::pair{2, 2}, {3, 7}, {17, 16}, {67, 5}}) {
    const BlockStencil s = random_stencil(static_cast<std::size_t>(nx), static_cast<std::size_t>(ny), 10, 1);
    const MatrixXd x = random_vectors(s, 3, 2), r = random_vectors(s, 3, 3), expected = s.dense() * x;
    auto blocks = std::make_shared<Array<T>>(this->queue_.array(s.as<T>()));
    StencilOperator<T> a(this->queue_, blocks, s.nx, s.ny);
    auto dx = upload<T>(this->queue_, x), y = upload<T>(this->queue_, x);
    a.apply(dx, y, 3);
    const double tolerance = 50 * this->eps() * largest(expected);
    EXPECT_LE(largest(download(this->queue_, y, 3) - expected), tolerance) << nx << "x" << ny;
    for (const std::size_t width : kWidths) {
      LevelsOnDevice<T> levels(this->queue_, coarsen_fully(even(s.nx, s.ny)), width, 3);
      const LevelLayout& level = levels.fine();
      levels.set_stencil(level, level.stencil, *blocks);
      levels.set(level, level.right(), r);
      levels.set(level, level.correction(), x);
      levels.kernel("multigrid", "residual")(levels.items(level), levels.constants, levels.vectors,
                                             levels.table, 0, levels.layout.vectors_size);
      EXPECT_LE(largest(levels.get(level, level.residual()) - (r - expected)), tolerance) << nx << "x" << ny;
    }
  }
}

// Sets of nodes that a smoother solves on: cells, rows (kX) or columns (kY) of cells.
std::vector<std::vector<Eigen::Index>> node_sets(const BlockStencil& s, ShortSide along) {
  const std::size_t width = along == ShortSide::kX ? s.nx : 2, height = along == ShortSide::kY ? s.ny : 2;
  std::vector<std::vector<Eigen::Index>> sets;
  for (std::size_t j = 0; j + height <= s.ny; ++j)
    for (std::size_t i = 0; i + width <= s.nx; ++i) {
      sets.emplace_back();
      for (std::size_t p = 0; p < width * height; ++p)
        for (std::size_t c = 0; c < 2; ++c)
          sets.back().push_back(static_cast<Eigen::Index>(2 * (i + p % width + s.nx * (j + p / width)) + c));
    }
  return sets;
}

// Sum of the inverses of the operator on these sets.
MatrixXd inverse_sum(const BlockStencil& s, ShortSide along) {
  const MatrixXd a = s.dense();
  MatrixXd m = MatrixXd::Zero(a.rows(), a.cols());
  for (const auto& set : node_sets(s, along)) m(set, set) += a(set, set).inverse();
  return m;
}

constexpr ShortSide kSmoothers[] = {ShortSide::kNeither, ShortSide::kX, ShortSide::kY};

// Sets the finest level's smoother of a stencil; the lines' factors, where it solves lines.
template <class T>
Array<T> make_smoother(const Queue& queue, const BlockStencil& s, ShortSide along, LevelsOnDevice<T>& levels,
                       Array<int>& indefinite) {
  const auto stencil = queue.array(s.as<T>());
  const LevelLayout& level = levels.fine();
  if (along != ShortSide::kNeither)
    return line_factor(queue, stencil, s.nx, s.ny, along == ShortSide::kX, indefinite);
  cell_smoother(queue, stencil, s.nx, s.ny, indefinite, levels.constants, level.smoother, level.stride);
  return {};
}

// Step k of smoothing the finest level by what make_smoother made.
template <class T>
void smooth(const Queue& queue, LevelsOnDevice<T>& levels, ShortSide along, const Array<T>& factor, int k,
            int from_zero) {
  const LevelLayout& level = levels.fine();
  const int size = levels.layout.vectors_size, along_x = along == ShortSide::kX;
  if (along == ShortSide::kNeither) {
    levels.kernel("multigrid", "smooth")(levels.items(level), levels.constants, levels.vectors, levels.table,
                                         0, size, k, from_zero);
    return;
  }
  const auto nx = static_cast<std::size_t>(level.nx), ny = static_cast<std::size_t>(level.ny);
  const std::size_t lines = (along_x ? ny : nx) - 1, count = levels.count();
  auto solved = queue.array<T>(8 * nx * ny * count);
  levels.kernel("lines", "solve_lines")({{lines, count}, {8}}, factor, levels.vectors, solved, levels.table,
                                        0, size, along_x, from_zero);
  levels.kernel("lines", "line_step")(grid_range(nx, ny, count), levels.constants, solved, levels.vectors,
                                      levels.table, 0, size, along_x, k, from_zero);
}

TYPED_TEST(Multigrid_, SmootherStepsMatchPlainLoops) {
  using T = TypeParam;
  for (const auto& [nx, ny] : {std::pair{2, 2}, {2, 9}, {9, 2}, {19, 6}})
    for (const ShortSide along : kSmoothers)
      for (const std::size_t width : kWidths) {
        const BlockStencil s =
            random_stencil(static_cast<std::size_t>(nx), static_cast<std::size_t>(ny), 10, 4);
        const MatrixXd m = inverse_sum(s, along), r = random_vectors(s, 2, 5), r2 = random_vectors(s, 2, 6);
        auto indefinite = this->queue_.array(std::vector<int>{0});
        LevelsOnDevice<T> levels(this->queue_, coarsen_fully(even(s.nx, s.ny)), width, 2,
                                 {T(0), T(0.4), T(0.3), T(0.7)});
        const auto factor = make_smoother<T>(this->queue_, s, along, levels, indefinite);
        EXPECT_EQ(this->queue_.read(indefinite)[0], 0);
        const LevelLayout& level = levels.fine();
        const MatrixXd rubbish = MatrixXd::Constant(r.rows(), 2, std::numeric_limits<double>::quiet_NaN());
        levels.set(level, level.direction(), rubbish);
        levels.set(level, level.correction(), rubbish);
        levels.set(level, level.right(), r);
        levels.set(level, level.residual(), r2);
        smooth(this->queue_, levels, along, factor, 0, 1);
        smooth(this->queue_, levels, along, factor, 1, 0);
        const MatrixXd d1 = 0.4 * m * r, d2 = 0.3 * d1 + 0.7 * m * r2, expected = d1 + d2;
        EXPECT_LE(largest(levels.get(level, level.direction()) - d2), 200 * this->eps() * largest(d2))
            << nx << "x" << ny;
        EXPECT_LE(largest(levels.get(level, level.correction()) - expected),
                  200 * this->eps() * largest(expected));
      }
}

TYPED_TEST(Multigrid_, SmootherTellsThatAnOperatorIsIndefinite) {
  using T = TypeParam;
  for (const ShortSide along : kSmoothers) {
    BlockStencil s = random_stencil(7, 8, 10, 4);
    s.blocks[4 * (4 * s.nodes() + 17)] = -1;
    auto indefinite = this->queue_.array(std::vector<int>{0});
    LevelsOnDevice<T> levels(this->queue_, coarsen_fully(even(s.nx, s.ny)), 1, 1);
    make_smoother<T>(this->queue_, s, along, levels, indefinite);
    EXPECT_EQ(this->queue_.read(indefinite)[0], 1);
  }
}

// P as a dense matrix, constrained unknowns masked.
MatrixXd interpolation(const GridTransfer& t, const std::vector<std::uint8_t>& fine_free,
                       const std::vector<std::uint8_t>& coarse_free) {
  const std::size_t nx = t.x.left.size(), coarse_nx = t.x.at.size();
  MatrixXd p = MatrixXd::Zero(static_cast<Eigen::Index>(fine_free.size()),
                              static_cast<Eigen::Index>(coarse_free.size()));
  const auto weight = [](const LineTransfer& line, std::size_t fine, std::size_t coarse) {
    const auto left = static_cast<std::size_t>(line.left[fine]);
    return left == coarse ? 1 - line.weight[fine] : left + 1 == coarse ? line.weight[fine] : 0;
  };
  for (std::size_t f = 0; f < fine_free.size(); ++f)
    for (std::size_t c = f % 2; c < coarse_free.size(); c += 2)
      if (fine_free[f] && coarse_free[c])
        p(static_cast<Eigen::Index>(f), static_cast<Eigen::Index>(c)) =
            weight(t.x, f / 2 % nx, c / 2 % coarse_nx) * weight(t.y, f / 2 / nx, c / 2 / coarse_nx);
  return p;
}

// The same with the nodes inside coarse cells in equilibrium, from the bilinear one.
MatrixXd in_equilibrium(const GridTransfer& t, const MatrixXd& a, const MatrixXd& bilinear) {
  const std::size_t nx = t.x.left.size();
  const MatrixXd force = a * bilinear;
  MatrixXd p = bilinear;
  for (std::size_t j = 0; j < t.y.left.size(); ++j)
    for (std::size_t i = 0; i < nx; ++i) {
      if (t.x.weight[i] == 0 || t.y.weight[j] == 0) continue;
      const auto n = static_cast<Eigen::Index>(2 * (i + nx * j));
      p.middleRows<2>(n) -= a.block<2, 2>(n, n).inverse() * force.middleRows<2>(n);
    }
  return p;
}

template <class T>
Array<T> values(const Queue& queue, const auto& v) {
  return queue.array(std::vector<T>(v.begin(), v.end()));
}

TYPED_TEST(Multigrid_, CoarseOperatorIsTheDenseTripleProduct) {
  using T = TypeParam;
  const Queue& queue = this->queue_;
  const BlockStencil s = random_stencil(14, 9, 10, 6);
  double spacing = 1;
  const GridTransfer t = coarsen(NodeLines{uneven(14, 1), uneven(9, 2)}, spacing);
  const int cx = static_cast<int>(t.x.at.size()), cy = static_cast<int>(t.y.at.size());
  ASSERT_LT(cx, 14);
  BlockStencil coarse{t.x.at.size(), t.y.at.size(), {}, {}};
  for (const int j : t.y.at)
    for (const int i : t.x.at)
      for (int c = 0; c < 2; ++c)
        coarse.free.push_back(s.free[static_cast<std::size_t>(2 * (i + 14 * j) + c)]);
  const MatrixXd a = s.dense(), p = interpolation(t, s.free, coarse.free);
  const auto fine_free = values<T>(queue, s.free), coarse_free = values<T>(queue, coarse.free);
  std::vector<int> places = t.x.at;
  for (const std::vector<int>* more : {&t.y.at, &t.x.left, &t.y.left})
    places.insert(places.end(), more->begin(), more->end());
  std::vector<double> shares = t.x.weight;
  shares.insert(shares.end(), t.y.weight.begin(), t.y.weight.end());
  const auto lines = queue.array(places);
  const auto weights = values<T>(queue, shares);
  const auto stencil = queue.array(s.as<T>());
  auto rows = queue.template array<T>(16 * (coarse.nx - 1) * (coarse.ny - 1));
  queue.kernel("galerkin", "interior_rows", precision_of<T>)(
      grid_range(coarse.nx - 1, coarse.ny - 1, 1), stencil, rows, lines, weights, fine_free, 14, 9, cx, cy);
  // P, P^T: the nodes inside coarse cells in equilibrium
  const MatrixXd equilibrium = in_equilibrium(t, a, p);
  const MatrixXd f = random_vectors(s, 2, 7), c = random_vectors(coarse, 2, 8);
  ASSERT_GT(largest((equilibrium - p) * c), 0.01);
  for (const std::size_t width : kWidths) {
    LevelsOnDevice<T> levels(queue, t, width, 2);
    const LevelLayout &fine = levels.fine(), &next = levels.layout.levels[1];
    levels.set_free(fine, s.free);
    levels.set_free(next, coarse.free);
    queue.kernel("planes", "inside_to_planes", precision_of<T>)(
        {{static_cast<std::size_t>(next.stride)}, {64}}, stencil, rows, fine_free, lines, weights,
        levels.constants, fine.inside, next.stride, 14, 9, cx, cy);
    levels.set(fine, fine.residual(), f);
    levels.set(fine, fine.correction(), f);
    const Range over_next{{static_cast<std::size_t>(next.span()), 2}, {64}};
    levels.kernel("multigrid", "restrict_residual")(over_next, levels.constants, levels.vectors, levels.table,
                                                    0, levels.layout.vectors_size);
    EXPECT_LE(largest(levels.get(next, next.right()) - equilibrium.transpose() * f), 200 * this->eps());
    levels.set(next, next.correction(), c);
    levels.kernel("multigrid", "prolong_add")(over_next, levels.constants, levels.vectors, levels.table, 0,
                                              levels.layout.vectors_size);
    EXPECT_LE(largest(levels.get(fine, fine.correction()) - (f + equilibrium * c)), 200 * this->eps());
  }
  // P^T A P
  auto product = queue.template array<T>(36 * coarse.nodes());
  queue.kernel("galerkin", "galerkin_product", precision_of<T>)(grid_range(coarse.nx, coarse.ny, 5), stencil,
                                                                rows, product, lines, weights, fine_free,
                                                                coarse_free, 14, 9, cx, cy);
  const std::vector<T> host = queue.read(product);
  coarse.blocks.assign(host.begin(), host.end());
  MatrixXd expected = equilibrium.transpose() * a * equilibrium;
  for (std::size_t n = 0; n < coarse.free.size(); ++n)
    if (!coarse.free[n]) expected(static_cast<Eigen::Index>(n), static_cast<Eigen::Index>(n)) = 1;
  EXPECT_LE(largest(coarse.dense() - expected), 200 * this->eps() * largest(expected));
}

TYPED_TEST(Multigrid_, CycleIsSymmetricAndPositiveDefinite) {
  using T = TypeParam;
  for (const auto& [nx, ny, stretch] : {std::tuple{12, 31, 1.0},
                                        {33, 33, 1.0},
                                        {40, 27, 1.0},
                                        {47, 33, 1.0},
                                        {21, 18, 20.0},
                                        {21, 18, 0.05}}) {
    const BlockStencil s = random_stencil(static_cast<std::size_t>(nx), static_cast<std::size_t>(ny), 100, 9);
    NodeLines lines{uneven(s.nx, 3), uneven(s.ny, 4)};
    for (double& y : lines.y) y *= stretch;
    Multigrid<T> m(this->queue_, lines);
    ASSERT_GE(m.levels(), 2u);
    m.set_operator(this->queue_.array(s.as<T>()), s.free);
    const std::size_t count = 6;
    const MatrixXd x = random_vectors(s, count, 10);
    auto dx = upload<T>(this->queue_, x), z = upload<T>(this->queue_, x);
    m.apply(dx, z, count);
    const MatrixXd gram = x.transpose() * download(this->queue_, z, count);
    EXPECT_LE(largest(gram - gram.transpose()), 500 * this->eps() * largest(gram)) << nx << "x" << ny;
    EXPECT_GT(Eigen::SelfAdjointEigenSolver<MatrixXd>(gram + gram.transpose()).eigenvalues().minCoeff(), 0);
  }
}

TEST(Multigrid, FloatInsideDoubleIsTheSameCycle) {
  const Queue queue = test_device()->queue();
  if (!queue.supports(Precision::kDouble)) GTEST_SKIP() << "device without double precision";
  const BlockStencil s = random_stencil(47, 33, 100, 9);
  const NodeLines lines{uneven(s.nx, 3), uneven(s.ny, 4)};
  Multigrid<double> exact(queue, lines);
  Multigrid<double, float> rounded(queue, lines);
  const auto stencil = queue.array(s.as<double>());
  exact.set_operator(stencil, s.free);
  rounded.set_operator(stencil, s.free);
  const MatrixXd x = random_vectors(s, 2, 10);
  auto dx = upload<double>(queue, x), z = upload<double>(queue, x);
  exact.apply(dx, z, 2);
  const MatrixXd expected = download(queue, z, 2);
  rounded.apply(dx, z, 2);
  const MatrixXd difference = download(queue, z, 2) - expected;
  EXPECT_LE(largest(difference), 500 * std::numeric_limits<float>::epsilon() * largest(expected));
  EXPECT_GT(largest(difference), 1e-9 * largest(expected));  // it is float
}

// A vector that is not a number spoils its own answer alone, and none after it.
TYPED_TEST(Multigrid_, WhatIsNotANumberDoesNotStay) {
  using T = TypeParam;
  const BlockStencil s = random_stencil(47, 33, 100, 9);
  Multigrid<T> m(this->queue_, {uneven(s.nx, 3), uneven(s.ny, 4)});
  m.set_operator(this->queue_.array(s.as<T>()), s.free);
  const MatrixXd x = random_vectors(s, 2, 10);
  MatrixXd spoilt = x;
  spoilt.col(0).setConstant(std::numeric_limits<double>::quiet_NaN());
  auto z = upload<T>(this->queue_, x);
  m.apply(upload<T>(this->queue_, x), z, 2);
  const MatrixXd expected = download(this->queue_, z, 2);
  m.apply(upload<T>(this->queue_, spoilt), z, 2);
  const MatrixXd beside = download(this->queue_, z, 2);
  EXPECT_TRUE(beside.col(0).hasNaN());
  EXPECT_EQ(beside.col(1), expected.col(1));
  m.apply(upload<T>(this->queue_, x), z, 2);
  EXPECT_EQ(download(this->queue_, z, 2), expected);
}

// On a thread that looks up, launches come in slices, the first of a kernel always.
TEST(Multigrid, InSlicesItIsTheSame) {
  constexpr std::size_t kVectors = 32;
  const BlockStencil s = random_stencil(40, 30, 10, 1);
  const MatrixXd r = random_vectors(s, kVectors, 3);
  const Queue queue = test_device()->queue();
  const auto stencil = queue.array(s.as<float>());
  const auto cycle = [&] {
    Multigrid<float> m(queue, even(40, 30));
    m.set_operator(stencil, s.free);
    const auto from = upload<float>(queue, r);
    auto to = queue.array<float>(from.size());
    m.apply(from, to, kVectors);
    return queue.read(to);
  };
  const std::vector<float> whole = cycle();
  const CancellationCheck check([] {});
  EXPECT_EQ(cycle(), whole);
}

TYPED_TEST(Multigrid_, SmallGridIsSolvedExactly) {
  using T = TypeParam;
  const BlockStencil s = random_stencil(9, 10, 10, 11);
  Multigrid<T> m(this->queue_, {uneven(9, 5), uneven(10, 6)});
  ASSERT_EQ(m.levels(), 1u);
  m.set_operator(this->queue_.array(s.as<T>()), s.free);
  const MatrixXd b = random_vectors(s, 2, 12), expected = s.dense().llt().solve(b);
  auto db = upload<T>(this->queue_, b), z = upload<T>(this->queue_, b);
  m.apply(db, z, 2);
  EXPECT_LE(largest(download(this->queue_, z, 2) - expected), 1e3 * this->eps() * largest(expected));
}

TEST(Multigrid, EigenvalueBoundsHoldAndAreTight) {
  const BlockStencil s = random_stencil(15, 14, 1000, 13);
  const MatrixXd a = s.dense(), root = a.llt().matrixL();
  for (const ShortSide along : kSmoothers) {
    const double truth = Eigen::SelfAdjointEigenSolver<MatrixXd>(
                             root.transpose() * inverse_sum(s, along) * root, Eigen::EigenvaluesOnly)
                             .eigenvalues()
                             .maxCoeff();
    const double bound = along == ShortSide::kNeither ? kLargestCellEigenvalue : kLargestLineEigenvalue;
    EXPECT_GE(bound, truth);
    // Three colours of lines, nine of cells: what holds for any stencil.
    EXPECT_LE(bound, (along == ShortSide::kNeither ? 1.7 : 1.2) * truth);
  }
}

TEST(Multigrid, OperatorThatIsNotPositiveDefiniteIsRefused) {
  BlockStencil s = random_stencil(15, 14, 10, 14);
  for (double& value : s.blocks) value = -value;
  const Queue queue = test_device()->queue();
  NodeLines tall{uneven(15, 5), uneven(14, 6)}, wide = tall;  // smoothed by lines
  for (double& y : tall.y) y *= 20;
  for (double& x : wide.x) x *= 20;
  EXPECT_EQ(short_side(tall), ShortSide::kX);
  EXPECT_EQ(short_side(wide), ShortSide::kY);
  for (const NodeLines& lines : {NodeLines{uneven(15, 5), uneven(14, 6)}, tall, wide}) {
    Multigrid<float> m(queue, lines);
    EXPECT_THROW(m.set_operator(queue.array(s.as<float>()), s.free), std::invalid_argument);
  }
}

}  // namespace
}  // namespace teletact::service
