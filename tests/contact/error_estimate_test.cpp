// What answers state as their error against their true one (T4.2, T4.7): the same contact over a compliance
// that was computed in long double, element matrices included.
#include <gtest/gtest.h>

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
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
using Vector = Eigen::Matrix<Real, Eigen::Dynamic, 1>;
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

// Its parts: shear, and bulk volume volume^T, which near nu = 1/2 must be kept apart to be exact.
struct Part {
  Element shear;
  Eigen::Matrix<Real, 8, 1> volume;
  std::array<Index, 8> dofs;
  Element stiffness() const { return shear + volume * volume.transpose(); }
  Eigen::Matrix<Real, 8, 1> force(const Eigen::Matrix<Real, 8, 1>& u) const {
    return shear * u + volume * volume.dot(u);
  }
};

Part element(Real width, Real height, Real e, Real nu) {
  const Real mu = e / (2 * (1 + nu)), lambda = e * nu / ((1 + nu) * (1 - 2 * nu)), half = Real(1) / 2;
  const Eigen::Matrix<Real, 3, 1> shear(2 * mu, 2 * mu, mu), trace(1, 1, 0);
  const Real at = std::sqrt(Real(1) / 12), area = width * height;
  Part part;
  part.shear.setZero();
  for (const Real s : {half - at, half + at})
    for (const Real t : {half - at, half + at}) {
      const auto b = strain(s, t, width, height);
      part.shear += area / 4 * b.transpose() * shear.asDiagonal() * b;
    }
  const auto b = strain(half, half, width, height);
  part.volume = std::sqrt(area * lambda) * b.transpose() * trace;
  return part;
}

// Of the surface, bottom fixed.
class ExactCompliance final : public Compliance {
 public:
  ExactCompliance(const TissueGrid& grid, const Material& material) {
    const Index free = Index(2 * grid.nx() * (grid.ny() - 1)), size = Index(2 * grid.nx());
    std::vector<Eigen::Triplet<Real>> entries;
    for (std::size_t j = 0; j + 1 < grid.ny(); ++j)
      for (std::size_t i = 0; i + 1 < grid.nx(); ++i) {
        Part part = element(Real(grid.x_m[i + 1]) - grid.x_m[i], Real(grid.y_m[j + 1]) - grid.y_m[j],
                            material.youngs_modulus_pa[grid.element(i, j)], material.poisson_ratio);
        const Element k = part.stiffness();
        const std::array nodes{grid.node(i, j), grid.node(i + 1, j), grid.node(i, j + 1),
                               grid.node(i + 1, j + 1)};
        std::array<Index, 8>& dofs = part.dofs;
        for (std::size_t a = 0; a < 8; ++a) dofs[a] = Index(2 * nodes[a / 2] + a % 2);
        for (Index a = 0; a < 8; ++a)
          for (Index b = 0; b < 8; ++b)
            if (dofs[std::size_t(a)] < free && dofs[std::size_t(b)] < free)
              entries.emplace_back(dofs[std::size_t(a)], dofs[std::size_t(b)], k(a, b));
        elements_.push_back(part);
      }
    Eigen::SparseMatrix<Real> k(free, free);
    k.setFromTriplets(entries.begin(), entries.end());
    const Eigen::SimplicialLDLT<Eigen::SparseMatrix<Real>> factor(k);
    s_.resize(size, size);
    for (Index q = 0; q < size; ++q) {
      const Vector f = Vector::Unit(free, q);
      Vector u = factor.solve(f);
      for (int pass = 0; pass < 3; ++pass) u += factor.solve(f - forces(u));  // the factor's rounding is felt
      s_.col(q) = u.head(size).cast<double>();
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
  // K u of the free unknowns, from differences of displacement within each element.
  Vector forces(const Vector& u) const {
    Vector f = Vector::Zero(u.size());
    for (const Part& part : elements_) {
      const auto of = [&](std::size_t a) { return part.dofs[a] < u.size() ? u[part.dofs[a]] : 0; };
      Eigen::Matrix<Real, 8, 1> local;
      for (std::size_t a = 0; a < 8; ++a) local[Index(a)] = of(a) - of(a % 2);
      const auto force = part.force(local);
      for (std::size_t a = 0; a < 8; ++a)
        if (part.dofs[a] < u.size()) f[part.dofs[a]] += force[Index(a)];
    }
    return f;
  }

  std::vector<Part> elements_;
  MatrixXd s_;
};

struct Tissue {
  TissueGrid grid;
  Material material;
  double contrast;
  std::shared_ptr<ExactCompliance> exact;
};

std::vector<Tissue> make_tissues(const std::vector<double>& contrasts) {
  std::vector<Tissue> all;
  for (const TissueGrid& grid : {tests::uniform_grid(31, 16), tests::uneven_grid(36, 19)})
    for (const double nu : {0.3, 0.49, 0.499, 0.4999})
      for (const double contrast : contrasts) {
        const auto add = [&](Material material) {
          auto exact = std::make_shared<ExactCompliance>(grid, material);
          all.push_back({grid, std::move(material), contrast, std::move(exact)});
        };
        add(tests::inclusion(grid, contrast, nu));
        if (contrast > 1) add(tests::scattered(grid, contrast, nu));
      }
  return all;
}

// Made once: long double takes its time.
const std::vector<Tissue>& tissues() {
  static const std::vector<Tissue> all = make_tissues({1, 10, 1e3, 1e6});
  return all;
}

// True error over the stated one, of touches all along the surface; returns the largest true one.
double add_touches(const TissueModel& model, Compliance& exact, Compliance& tried,
                   std::vector<double>& ratios) {
  double largest = 0;
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
      largest = std::fmax(largest, std::isnan(error) ? INFINITY : error);
    }
  return largest;
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
  for (const Tissue& t : tissues()) {
    const TissueModel model(t.grid, t.material, {}, {});
    add_touches(model, *t.exact, *model.condensed(0), beforehand);
    while (model.measure_rounding(0)) {
    }
    add_touches(model, *t.exact, *model.condensed(0), measured);
  }
  judge("condensed, beforehand", beforehand);
  EXPECT_LE(judge("condensed, measured", measured), 5);
}

// Empty: what the product picks.
class PcgErrorEstimate : public testing::TestWithParam<std::optional<SolvePrecision>> {};

TEST_P(PcgErrorEstimate, BoundsAndIsClose) {
  const auto device = service::Device::open();
  if (GetParam() == SolvePrecision::kDouble && !device->info().has_double)
    GTEST_SKIP() << "device without double";
  service::ElasticitySolverOptions options;
  if (GetParam()) options.precision = *GetParam();
  double largest = 0;
  std::vector<double> ratios;
  for (const Tissue& t : tissues()) {
    if (t.contrast != 10 && t.contrast != 1e3) continue;
    const TissueModel model(t.grid, t.material, {}, {});
    const auto columns = GetParam() ? model.iterative(0, device, options) : model.iterative(0, device);
    largest = std::max(largest, add_touches(model, *t.exact, *columns, ratios));
  }
  std::printf("largest error of a force: %.1e\n", largest);
  // Near nu = 1/2 too: the product with K rounds no change of volume apart.
  EXPECT_LE(largest, GetParam() == SolvePrecision::kFloat ? 1e-5 : GetParam() ? 1e-13 : 1e-6);
  EXPECT_LE(judge("conjugate gradients", ratios), 5);
}

INSTANTIATE_TEST_SUITE_P(Contact, PcgErrorEstimate,
                         testing::Values(SolvePrecision::kFloat, SolvePrecision::kDouble,
                                         SolvePrecision::kRefined, std::nullopt),
                         [](const auto& instance) {
                           return std::string(!instance.param                             ? "Product"
                                              : instance.param == SolvePrecision::kFloat  ? "Float"
                                              : instance.param == SolvePrecision::kDouble ? "Double"
                                                                                          : "Refined");
                         });

}  // namespace
}  // namespace teletact
