// The single-node contact on solid tissue: against the exact theory of layers, against a sparse factor, its
// derivatives, and what it states that it is off by.
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <string>
#include <vector>

#include "service/contact/solid_contact.h"
#include "tests/reference/solid.h"
#include "tests/solver/block_stencil.h"
#include "tests/tissue/solid/solids.h"

namespace teletact::service {
namespace {

constexpr double kMiddle = 0.032;
constexpr Fingertip kHat{.shape = FingertipShape::kNode};
constexpr Fingertip kFoot{.shape = FingertipShape::kNode, .footprint_m = 0.002};
constexpr Fingertip kStuckFoot{
    .shape = FingertipShape::kNode, .friction = Friction::kStuck, .footprint_m = 0.002};

Queue queue() {
  return test_device()->queue();
}
bool has_double() {
  return queue().supports(Precision::kDouble);
}

SolidTissue with_ball() {
  return solid({32, 32, 0.002, 0.002, graded_rows(0.040, 12, 1.06)}, 0.49, [](double x, double y, double z) {
    return std::hypot(x - kMiddle, y - 0.012, z - kMiddle) < 0.008 ? 1e5 : 1e4;
  });
}

// A Gaussian footprint on a bonded layer H deep: A = (1 - nu^2) / (pi E) Int M(k H) exp(-k^2 sigma^2) dk, M
// the layer's kernel over the half space's.
double exact_compliance(double sigma_m, double depth_m, double modulus_pa, double nu) {
  const double kappa = 3 - 4 * nu;
  double sum = 0;
  const double step = 0.002 / depth_m;
  for (double k = step / 2; k * sigma_m < 6; k += step) {
    const double s = k * depth_m, far = std::exp(-2 * s);  // over cosh 2s / (1 + exp(-4s))
    const double layer = (kappa * (1 - far * far) - 4 * s * far) /
                         (kappa * (1 + far * far) + (4 * s * s + 1 + kappa * kappa) * far);
    sum += step * layer * std::exp(-k * k * sigma_m * sigma_m);
  }
  return (1 - nu * nu) / (std::numbers::pi * modulus_pa) * sum;
}

// By extrapolation from two meshes, 2 and 1 mm.
TEST(SolidNode, OnAHomogeneousLayerAFootprintIsTheExactOnes) {
  if (!has_double()) GTEST_SKIP() << "the device has no double";
  const auto stiffness = [](std::size_t columns, std::size_t layers, double growth) {
    const double h = 2 * kMiddle / double(columns);
    const SolidTissue tissue = solid({columns, columns, h, h, graded_rows(0.040, layers, growth)}, 0.49,
                                     [](double, double, double) { return 1e4; });
    SolidContact<double> contact(queue(), tissue);
    double low = HUGE_VAL, high = 0;
    for (const double x : {0.0, 0.3, 0.5})
      for (const double z : {0.0, 0.2, 0.5}) {
        const ContactAnswer a = contact.touch(kFoot, {kMiddle + x * h, 0.001, kMiddle + z * h});
        EXPECT_NEAR(a.tangent_n_m[4], a.force_n[1] / 0.001, 1e-9 * -a.tangent_n_m[4]) << "linear";
        low = std::min(low, -a.force_n[1]);
        high = std::max(high, -a.force_n[1]);
      }
    EXPECT_LT(high - low, 1e-3 * high) << "ripple of the mesh";
    EXPECT_EQ(contact.corrections(), 0u) << "layered tissue needs none";
    return high / 0.001;
  };
  const double coarse = stiffness(32, 16, 1.04 * 1.04), fine = stiffness(64, 32, 1.04);
  const double exact = 1 / exact_compliance(0.002, 0.040, 1e4, 0.49);
  EXPECT_NEAR((4 * fine - coarse) / 3, exact, 0.003 * exact) << coarse << ", " << fine;
}

// Weights over the whole surface, by the nearest of the period's copies.
Eigen::VectorXd weights(const SolidGrid& grid, double sigma_m, double x_m, double z_m) {
  const auto one = [&](double at_m, double spacing_m, std::size_t n) {
    const double period = double(n) * spacing_m, d = std::remainder(at_m, period);
    return sigma_m > 0 ? std::exp(-d * d / (2 * sigma_m * sigma_m))
                       : std::max(0.0, 1 - std::abs(d) / spacing_m);
  };
  Eigen::VectorXd w(Eigen::Index(grid.columns()));
  for (std::size_t n = 0; n < grid.columns(); ++n)
    w[Eigen::Index(n)] = one(double(n % grid.nx) * grid.spacing_x_m - x_m, grid.spacing_x_m, grid.nx) *
                         one(double(n / grid.nx) * grid.spacing_z_m - z_m, grid.spacing_z_m, grid.nz);
  return w / w.sum();
}

// f.(B^T S B) f / 2 - f_y d at its least, all by the sparse factor.
TEST(SolidNode, IsTheSparseFactors) {
  if (!has_double()) GTEST_SKIP() << "the device has no double";
  const SolidTissue tissue = lump_in_waves();
  const SolidGrid& grid = tissue.grid;
  const auto columns = Eigen::Index(grid.columns());
  SolidContact<double> contact(queue(), tissue);
  const reference::SolidReference truth(tissue);
  // The truth's block is periodic; what the wider surface gives beyond that is the layered tissue's.
  const LayeredTissue layers = layered(tissue);
  const SurfaceCompliance wide = wide_surface(grid, layers, 0.49, choices::kMinPeriod * 0.020);
  const SurfaceCompliance periodic = wide_surface(grid, layers, 0.49, 0);
  const Vector3 pose{0.0312, 0.0018, 0.0193};
  for (const double sigma : {0.0, 0.0015}) {
    const Eigen::VectorXd w = weights(grid, sigma, pose[0], pose[2]);
    std::vector<std::size_t> nodes(grid.columns());
    Eigen::Matrix3d a;
    for (std::size_t q = 0; q < 3; ++q) {
      Eigen::VectorXd load = Eigen::VectorXd::Zero(Eigen::Index(grid.unknowns()));
      load.segment(Eigen::Index(q) * columns, columns) = w;
      for (std::size_t n = 0; n < nodes.size(); ++n) nodes[n] = q * nodes.size() + n;
      const auto moves = [&](const SurfaceCompliance& s) { return s.times(nodes, w, 0, 3); };
      const Eigen::VectorXd moved = truth.solve(load).head(3 * columns) + moves(wide) - moves(periodic);
      for (Eigen::Index p = 0; p < 3; ++p) a(p, Eigen::Index(q)) = w.dot(moved.segment(p * columns, columns));
    }
    for (const Friction friction : {Friction::kFrictionless, Friction::kStuck}) {
      const bool stuck = friction == Friction::kStuck;
      const ContactAnswer answer =
          contact.touch({.shape = FingertipShape::kNode, .friction = friction, .footprint_m = sigma}, pose,
                        {.force_error = 1e-8});
      const double f = pose[1] * (stuck ? Eigen::Matrix3d(a.inverse())(1, 1) : 1 / a(1, 1));
      EXPECT_EQ(answer.state, ContactState::kContact);
      EXPECT_NEAR(-answer.force_n[1], f, 1e-6 * f) << sigma << (stuck ? ", stuck" : "");
      EXPECT_NEAR(answer.energy_j, f * pose[1] / 2, 1e-6 * answer.energy_j);
      double sum = 0;
      Vector3 sideways{};
      for (const NodalPressure& node : answer.pressure) {
        sum += node.pressure_pa * grid.spacing_x_m * grid.spacing_z_m;
        for (const std::size_t c : {0U, 2U})
          sideways[c] += node.traction_pa[c] * grid.spacing_x_m * grid.spacing_z_m;
      }
      EXPECT_NEAR(sum, f, 1e-6 * f);
      if (stuck)
        EXPECT_NEAR(sideways[0], pose[1] * Eigen::Matrix3d(a.inverse())(0, 1), 1e-4 * f);
      else
        EXPECT_EQ(sideways[0], 0);
    }
  }
  EXPECT_GT(contact.corrections(), 0u);
}

TEST(SolidNode, ForceAndTangentAreTheEnergysDerivatives) {
  if (!has_double()) GTEST_SKIP() << "the device has no double";
  SolidContact<double> contact(queue(), with_ball());
  const SolidContactOptions exact{.force_error = 1e-8};
  const Vector3 pose{kMiddle + 0.0043, 0.0021, kMiddle - 0.0027};
  for (const Fingertip& tip : {kHat, kFoot, kStuckFoot}) {
    const ContactAnswer answer = contact.touch(tip, pose, exact);
    const double size = std::abs(answer.force_n[1]), stiff = std::abs(answer.tangent_n_m[4]);
    EXPECT_GT(std::abs(answer.force_n[0]), 1e-3 * size) << "the ball pushes sideways";
    for (std::size_t c = 0; c < 3; ++c) {
      constexpr double kStep = 5e-6;
      Vector3 after = pose, before = pose;
      after[c] += kStep;
      before[c] -= kStep;
      const ContactAnswer a = contact.touch(tip, after, exact), b = contact.touch(tip, before, exact);
      EXPECT_NEAR(answer.force_n[c], -(a.energy_j - b.energy_j) / (2 * kStep), 1e-4 * size);
      for (std::size_t d = 0; d < 3; ++d) {
        EXPECT_NEAR(answer.tangent_n_m[3 * d + c], (a.force_n[d] - b.force_n[d]) / (2 * kStep), 1e-3 * stiff)
            << "dF" << d << "/d" << c
            << (tip == kHat    ? " hat"
                : tip == kFoot ? " foot"
                               : " stuck");
        EXPECT_EQ(answer.tangent_n_m[3 * d + c], answer.tangent_n_m[3 * c + d]);
      }
    }
  }
}

TEST(SolidNode, StatesWhatItIsOffBy) {
  if (!has_double()) GTEST_SKIP() << "the device has no double";
  const SolidTissue tissue = with_ball();
  SolidContact<double> exact(queue(), tissue);
  for (const Fingertip& tip : {kFoot, kStuckFoot}) {
    SolidContact<float> contact(queue(), tissue);
    std::size_t touches = 0, covered = 0;
    for (double x = -0.016; x < 0.016; x += 0.0017, ++touches) {
      const Vector3 pose{kMiddle + x, 0.001, kMiddle + 0.003 * std::sin(200 * x)};
      const ContactAnswer a = contact.touch(tip, pose, {.force_error = 0.02});
      const ContactAnswer b = exact.touch(tip, pose, {.force_error = 1e-6});
      EXPECT_LE(a.solve.relative_error, 0.02);
      const Eigen::Vector3d f(a.force_n.data()), truth(b.force_n.data());
      covered += (f - truth).norm() <= a.solve.relative_error * truth.norm();
    }
    EXPECT_GE(covered, touches - touches / 20);
    EXPECT_GT(contact.corrections(), 0u);
    EXPECT_LT(contact.corrections(), 2 * touches);
  }
}

TEST(SolidNode, RefusesFootprintsThatAreNone) {
  SolidContact<float> contact(queue(), with_ball());
  const auto why = [&](double footprint_m, Friction friction = Friction::kFrictionless) -> std::string {
    try {
      contact.touch({.shape = FingertipShape::kNode, .friction = friction, .footprint_m = footprint_m},
                    {kMiddle, 0.001, kMiddle});
      return "";
    } catch (const std::invalid_argument& e) {
      return e.what();
    } catch (const std::out_of_range& e) {
      return e.what();
    }
  };
  EXPECT_EQ(why(0), "");
  EXPECT_EQ(why(0.001), "") << "half of the spacing is wide enough";
  EXPECT_EQ(why(0.0009).rfind("fingertip.footprint_m", 0), 0u) << why(0.0009);
  EXPECT_NE(why(0.004).find("too wide for the block"), std::string::npos) << why(0.004);
  EXPECT_EQ(why(0.003), "");
  EXPECT_NE(why(0.003, Friction::kStuck).find("more than can be solved"), std::string::npos);
  EXPECT_EQ(contact.touch(kFoot, {kMiddle, 0, kMiddle}).state, ContactState::kNoContact);
}

}  // namespace
}  // namespace teletact::service
