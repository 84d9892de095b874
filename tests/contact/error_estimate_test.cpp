// What answers state as their error against their true one (T4.2, T4.7): the same contact over a compliance
// that was computed in long double, element matrices included.
#include <gtest/gtest.h>

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <vector>

#include "service/contact/contact.h"
#include "service/tissue/elasticity_solver.h"
#include "tests/tissue/tissue_cases.h"

namespace teletact {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using service::Compliance;
using service::ContactPose;
using service::Fingertip;
using service::Friction;
using service::Material;
using service::SolvePrecision;
using service::SolveReport;
using service::TissueGrid;
using service::TissueModel;
using Real = long double;
using Element = Eigen::Matrix<Real, 8, 8>;

// Strain [eps_xx, eps_yy, gamma_xy] of the eight displacements at (s, t) in [0, 1]^2.
Eigen::Matrix<Real, 3, 8> strain(Real s, Real t, Real width, Real height) {
  const std::array<Real, 4> gx{-(1 - t) / width, (1 - t) / width, -t / width, t / width};
  const std::array<Real, 4> gy{-(1 - s) / height, -s / height, (1 - s) / height, s / height};
  Eigen::Matrix<Real, 3, 8> b = Eigen::Matrix<Real, 3, 8>::Zero();
  for (Index a = 0; a < 4; ++a) {
    b(0, 2 * a) = b(2, 2 * a + 1) = gx[std::size_t(a)];
    b(1, 2 * a + 1) = b(2, 2 * a) = gy[std::size_t(a)];
  }
  return b;
}

Element element(Real width, Real height, Real e, Real nu) {
  const Real mu = e / (2 * (1 + nu)), lambda = e * nu / ((1 + nu) * (1 - 2 * nu)), half = Real(1) / 2;
  const Eigen::Matrix<Real, 3, 1> shear(2 * mu, 2 * mu, mu), trace(1, 1, 0);
  const Real at = std::sqrt(Real(1) / 12), area = width * height;
  Element k = Element::Zero();
  for (const Real s : {half - at, half + at})
    for (const Real t : {half - at, half + at}) {
      const auto b = strain(s, t, width, height);
      k += area / 4 * b.transpose() * shear.asDiagonal() * b;
    }
  const auto b = strain(half, half, width, height);
  return k + area * lambda * (b.transpose() * trace) * (trace.transpose() * b);
}

// Of the surface, bottom fixed.
class ExactCompliance final : public Compliance {
 public:
  ExactCompliance(const TissueGrid& grid, const Material& material) {
    const Index free = Index(2 * grid.nx() * (grid.ny() - 1)), size = Index(2 * grid.nx());
    std::vector<Eigen::Triplet<Real>> entries;
    for (std::size_t j = 0; j + 1 < grid.ny(); ++j)
      for (std::size_t i = 0; i + 1 < grid.nx(); ++i) {
        const Element k = element(Real(grid.x_m[i + 1]) - grid.x_m[i], Real(grid.y_m[j + 1]) - grid.y_m[j],
                                  material.youngs_modulus_pa[grid.element(i, j)], material.poisson_ratio);
        const std::array nodes{grid.node(i, j), grid.node(i + 1, j), grid.node(i, j + 1),
                               grid.node(i + 1, j + 1)};
        const auto dof = [&](Index a) { return Index(2 * nodes[std::size_t(a / 2)]) + a % 2; };
        for (Index a = 0; a < 8; ++a)
          for (Index b = 0; b < 8; ++b)
            if (dof(a) < free && dof(b) < free) entries.emplace_back(dof(a), dof(b), k(a, b));
      }
    Eigen::SparseMatrix<Real> k(free, free);
    k.setFromTriplets(entries.begin(), entries.end());
    const Eigen::SimplicialLDLT<Eigen::SparseMatrix<Real>> factor(k);
    s_.resize(size, size);
    for (Index q = 0; q < size; ++q) {
      Eigen::Matrix<Real, Eigen::Dynamic, 1> f = Eigen::Matrix<Real, Eigen::Dynamic, 1>::Unit(free, q);
      s_.col(q) = factor.solve(f).head(size).cast<double>();
    }
  }
  MatrixXd among(std::span<const std::size_t> nodes, SolveReport*) override {
    std::vector<Index> at;
    for (const std::size_t node : nodes) at.insert(at.end(), {Index(2 * node), Index(2 * node + 1)});
    return s_(at, at);
  }
  MatrixXd axial_among(std::span<const std::size_t> nodes, SolveReport*) override {
    std::vector<Index> at;
    for (const std::size_t node : nodes) at.push_back(Index(2 * node + 1));
    return s_(at, at);
  }

 private:
  MatrixXd s_;
};

struct Tissue {
  TissueGrid grid;
  Material material;
};

std::vector<Tissue> tissues(const std::vector<double>& contrasts) {
  std::vector<Tissue> all;
  for (const TissueGrid& grid : {tests::uniform_grid(31, 16), tests::uneven_grid(36, 19)})
    for (const double nu : {0.3, 0.49, 0.499, 0.4999})
      for (const double contrast : contrasts) {
        all.push_back({grid, tests::inclusion(grid, contrast, nu)});
        if (contrast > 1) all.push_back({grid, tests::scattered(grid, contrast, nu)});
      }
  return all;
}

// True error over the stated one, of touches all along the surface.
void add_touches(const TissueModel& model, Compliance& exact, Compliance& tried,
                 std::vector<double>& ratios) {
  const auto& x = model.grid().x_m;
  for (const double share : {0.22, 0.31, 0.4, 0.5, 0.63, 0.72})
    for (const Friction friction : {Friction::kFrictionless, Friction::kStuck}) {
      const Fingertip tip{.friction = friction};
      const ContactPose pose{x.front() + share * (x.back() - x.front()), 0.001};
      const auto answer = service::solve_contact(model, 0, tried, tip, pose);
      const auto truth = service::solve_contact(model, 0, exact, tip, pose).force_n;
      const double error = std::hypot(answer.force_n[0] - truth[0], answer.force_n[1] - truth[1]) /
                           std::hypot(truth[0], truth[1]);
      ratios.push_back(error / answer.solve.relative_error);
    }
}

// Prints what the estimates are worth; returns how many times too large they are in the median.
double judge(const char* what, std::vector<double> ratios) {
  EXPECT_TRUE(std::none_of(ratios.begin(), ratios.end(), [](double r) { return std::isnan(r); })) << what;
  std::sort(ratios.begin(), ratios.end());
  const auto at = [&](double share) { return ratios[std::size_t(share * double(ratios.size() - 1))]; };
  const auto bounded = std::upper_bound(ratios.begin(), ratios.end(), 1.0) - ratios.begin();
  std::printf("%s: %zu touches, %.2f %% within what is stated, which is %.1f times the error in the median\n",
              what, ratios.size(), 100 * double(bounded) / double(ratios.size()), 1 / at(0.5));
  EXPECT_GE(double(bounded), 0.99 * double(ratios.size())) << what << ", 99 % at " << at(0.99);
  return 1 / at(0.5);
}

TEST(ErrorEstimate, OfTheCondensedModelBoundsAndIsClose) {
  std::vector<double> beforehand, measured;
  for (const auto& [grid, material] : tissues({1, 10, 1e3, 1e6})) {
    const TissueModel model(grid, material, {}, {});
    ExactCompliance exact(grid, material);
    add_touches(model, exact, *model.condensed(0), beforehand);
    while (model.measure_rounding(0)) {
    }
    add_touches(model, exact, *model.condensed(0), measured);
  }
  judge("condensed, beforehand", beforehand);
  EXPECT_LE(judge("condensed, measured", measured), 5);
}

class PcgErrorEstimate : public testing::TestWithParam<SolvePrecision> {};

TEST_P(PcgErrorEstimate, Bounds) {
  const auto device = service::Device::open();
  if (GetParam() == SolvePrecision::kDouble && !device->info().has_double)
    GTEST_SKIP() << "device without double";
  service::ElasticitySolverOptions options;
  options.precision = GetParam();
  std::vector<double> ratios;
  for (const auto& [grid, material] : tissues({10, 1e3})) {
    if (grid.nx() != 31) continue;  // the other costs as much again
    const TissueModel model(grid, material, {}, {});
    ExactCompliance exact(grid, material);
    add_touches(model, exact, *model.iterative(0, device, options), ratios);
  }
  EXPECT_LE(judge("conjugate gradients", ratios), 100);
}

INSTANTIATE_TEST_SUITE_P(Contact, PcgErrorEstimate,
                         testing::Values(SolvePrecision::kFloat, SolvePrecision::kDouble,
                                         SolvePrecision::kRefined),
                         [](const auto& instance) {
                           return std::string(instance.param == SolvePrecision::kFloat    ? "Float"
                                              : instance.param == SolvePrecision::kDouble ? "Double"
                                                                                          : "Refined");
                         });

}  // namespace
}  // namespace teletact
