// The derivatives that the iterative modulus descends by (T3.3), against central differences of a reference
// that shares none of its formulas.
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "service/imaging/modulus/problem.h"
#include "tests/reference/modulus_objective.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double kWidthM = 0.0155, kBackgroundPa = 8e3, kIndependentM2 = 1.9e-6;
constexpr double kTolerance = 1e-5;  // of a derivative along a direction
const ImageGrid kImage{29, 27, 0.3e-3, 0.2e-3, 0.52e-3, 0.41e-3};

TissueExtent tissue(Plane plane) {
  return {0.060, 0.0125, 0.017, plane == Plane::kStrain ? 0.49 : 0.45, plane};
}

VectorXd random_vector(std::size_t size, double amplitude, unsigned seed) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal(0, amplitude);
  VectorXd v(static_cast<Index>(size));
  for (double& value : v) value = normal(random);
  return v;
}

// Directions: everything at random, and elements under the probe, at its edge, deep and far beside it.
std::vector<VectorXd> directions(const StripModel& model) {
  const TissueGrid& g = model.grid();
  std::vector<VectorXd> out;
  for (unsigned seed = 1; seed <= 4; ++seed) out.push_back(random_vector(g.elements(), 1, 100 + seed));
  const std::size_t middle = (model.first_column() + model.last_column()) / 2;
  for (const std::size_t e :
       {g.element(middle, 0), g.element(middle, g.ny() / 2), g.element(middle, g.ny() - 2),
        g.element(model.first_column(), 1), g.element(model.last_column() - 1, 3), g.element(0, g.ny() / 2)})
    out.push_back(VectorXd::Unit(static_cast<Index>(g.elements()), static_cast<Index>(e)));
  return out;
}

// Central difference, the error of the fourth order: (8 (f(h) - f(-h)) - (f(2h) - f(-2h))) / 12 h.
template <class Function>
auto slope(const Function& f, double h) -> decltype(f(h)) {
  return ((8 * (f(h) - f(-h)) - (f(2 * h) - f(-2 * h))) / (12 * h));
}

class Gradient : public ::testing::TestWithParam<Plane> {
 protected:
  Gradient() : model(tissue(GetParam()), kWidthM), elements(model.grid().elements()) {
    theta = random_vector(elements, 0.4, 1);
    measured.grid = kImage;
    const VectorXd noise = random_vector(kImage.size(), 2e-6, 2);
    for (std::size_t n = 0; n < kImage.size(); ++n) {
      const double x = kImage.origin_x_m + double(n % kImage.nx) * kImage.dx_m,
                   y = kImage.origin_y_m + double(n / kImage.nx) * kImage.dy_m;
      const double u = 110e-6 * (1 - y / 0.0125) * (1 + 0.2 * std::sin(400 * x)) + noise[Index(n)];
      measured.axial_displacement.push_back(static_cast<float>(u));
      measured.displacement_valid.push_back(n % 11 != 3);
      measured.axial_displacement_std.push_back(static_cast<float>(1e-6 * (1 + 0.5 * std::cos(double(n)))));
    }
  }
  ModulusProblem problem() {
    return {model, DisplacementData(model, measured, 0, kIndependentM2), random_vector(elements, 0.1, 3),
            kBackgroundPa};
  }
  reference::ModulusObjective objective() const {
    const TissueGrid& g = model.grid();
    reference::ModulusObjective o;
    o.grid = g;
    o.first_column = model.first_column(), o.last_column = model.last_column();
    o.poisson_ratio = tissue(GetParam()).poisson_ratio;
    o.plane_stress = GetParam() == Plane::kStress;
    o.background_pa = kBackgroundPa;
    for (std::size_t n = 0; n < kImage.size(); ++n)
      if (measured.displacement_valid[n])
        o.data.push_back({kImage.origin_x_m + double(n % kImage.nx) * kImage.dx_m,
                          kImage.origin_y_m + double(n / kImage.nx) * kImage.dy_m,
                          measured.axial_displacement[n], measured.axial_displacement_std[n]});
    o.independence = kImage.dx_m * kImage.dy_m / kIndependentM2;
    o.tv = kTvPerM, o.tv_floor_per_m = kTvFloorPerM;
    o.prior = random_vector(elements, 0.1, 3);
    o.prior_weight = VectorXd(Index(elements));
    for (std::size_t e = 0; e < elements; ++e) {
      const std::size_t i = e % (g.nx() - 1), j = e / (g.nx() - 1);
      const bool beside = i < model.first_column() || i >= model.last_column();
      o.prior_weight[Index(e)] = (beside ? kPriorBeside : 1) * (g.x_m[i + 1] - g.x_m[i]) *
                                 (g.y_m[j + 1] - g.y_m[j]) / (1e-6 * std::pow(kPriorDeviation, 2));
    }
    return o;
  }
  StripModel model;
  std::size_t elements;
  VectorXd theta;
  Measured measured;
};

TEST_P(Gradient, OfTheObjectiveIsThatOfTheReference) {
  ModulusProblem product = problem();
  const reference::ModulusObjective plain = objective();
  const ModulusProblem::Point point = product.at(theta);
  EXPECT_NEAR(point.objective, plain.value(theta), 1e-6 * plain.value(theta));
  const VectorXd gradient = product.gradient(point);
  for (const VectorXd& along : directions(model)) {
    const double want = slope([&](double h) { return plain.value(theta + h * along); }, 1e-3);
    EXPECT_NEAR(gradient.dot(along), want, kTolerance * std::abs(want));
  }
}

// The step goes down, and far: the noise alone keeps a good part of the objective.
TEST_P(Gradient, StepDescends) {
  ModulusProblem product = problem();
  const ModulusProblem::Point point = product.at(theta);
  const VectorXd step = product.step(point);
  EXPECT_LT(product.gradient(point).dot(step), 0);
  EXPECT_LT(product.at(theta + step).objective, 0.7 * point.objective);
}

TEST_P(Gradient, OfTheVariationIsThatOfTheReference) {
  const TotalVariation variation(model.grid());
  const reference::ModulusObjective plain = objective();
  EXPECT_NEAR(variation.value(theta), plain.variation(theta), 1e-12 * plain.variation(theta));
  const VectorXd gradient = variation.lagged(theta) * theta;
  for (const VectorXd& along : directions(model)) {
    const double want = slope([&](double h) { return plain.variation(theta + h * along); }, 1e-4);
    EXPECT_NEAR(gradient.dot(along), want, kTolerance * std::abs(want));
    constexpr double kEdgePerM = 30;
    const double of_edges =
        slope([&](double h) { return variation.value(theta + h * along, kEdgePerM); }, 1e-4);
    EXPECT_NEAR((variation.lagged(theta, kEdgePerM) * theta).dot(along), of_edges,
                kTolerance * std::abs(of_edges));
  }
}

// u, its change with the modulus, and the change's transposed.
TEST_P(Gradient, OfTheDisplacementIsThatOfTheReference) {
  const reference::ModulusObjective plain = objective();
  std::vector<double> modulus;
  for (const double t : theta) modulus.push_back(kBackgroundPa * std::exp(t));
  const StripResponse at = model.solve(modulus);
  const Eigen::Map<const VectorXd> u(at.displacement.data(), Index(at.displacement.size()));
  EXPECT_LE((u - plain.displacement(theta)).cwiseAbs().maxCoeff(), 1e-9);
  VectorXd load = random_vector(at.displacement.size(), 1, 9);
  const std::vector<double> sensitivity = model.sensitivity(at, {load.begin(), load.end()});
  // Loads where the displacement is prescribed move nothing.
  for (Index d = 0; d < u.size(); ++d)
    if (u[d] == 1 || u[d] == 0) load[d] = 0;
  for (const VectorXd& along : directions(model)) {
    const VectorXd want =
        slope([&](double h) -> VectorXd { return plain.displacement(theta + h * along); }, 1e-3);
    std::vector<double> change(elements);
    double by_adjoint = 0;
    for (std::size_t e = 0; e < elements; ++e) {
      change[e] = modulus[e] * along[Index(e)];
      by_adjoint += sensitivity[e] * change[e];
    }
    const std::vector<double> got = model.change(at, change);
    const VectorXd off = Eigen::Map<const VectorXd>(got.data(), want.size()) - want;
    EXPECT_LE(off.cwiseAbs().maxCoeff(), kTolerance * want.cwiseAbs().maxCoeff());
    EXPECT_LE(off.norm(), kTolerance * want.norm());
    EXPECT_NEAR(by_adjoint, load.dot(want), kTolerance * load.norm() * want.norm());
  }
}

INSTANTIATE_TEST_SUITE_P(Planes, Gradient, ::testing::Values(Plane::kStrain, Plane::kStress));

}  // namespace
}  // namespace teletact::service
