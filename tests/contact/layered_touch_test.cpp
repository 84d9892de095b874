// The exact touch of layered tissue, and answers on nodes whose layered part is made exact by it.
#include "service/contact/layered_touch.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <numbers>
#include <utility>

#include "service/contact/solid_contact.h"
#include "tests/solver/block_stencil.h"
#include "tests/tissue/solid/solids.h"

namespace teletact::service {
namespace {

Fingertip tip_of(FingertipShape shape) {
  Fingertip tip;
  tip.shape = shape;
  return tip;
}
const Fingertip kRounded = tip_of(FingertipShape::kRoundedTip);

// Of a paraboloid of 8 mm, nu 0.49, by another program: Fredholm's equation at 32 and 48 points.
TEST(LayeredTouch, IsTheReferenceForces) {
  const struct {
    LayerStack stack;
    double force_n[3];  // 1, 2 and 4 mm deep
  } kCases[] = {{{{0.1}, {1e4}, 0.49}, {0.0512389, 0.1469131, 0.4237821}},
                {{{0.04}, {1e4}, 0.49}, {0.0538890, 0.1581039, 0.4721386}},
                {{{0.01}, {1e4}, 0.49}, {0.0725967, 0.2490097, 0.9399686}},
                {{{0.01, 0.03}, {1e4, 3e4}, 0.49}, {0.0637098, 0.2021822, 0.6733664}},
                {{{0.01, 0.03}, {3e4, 1e4}, 0.49}, {0.1252700, 0.3361256, 0.8984514}}};
  for (const auto& c : kCases) {
    const LayeredTouch touch(c.stack, kRounded);
    for (const int n : {0, 1, 2}) {
      const double d = 1e-3 * std::pow(2.0, n);
      EXPECT_NEAR(touch.at(d).force_n, c.force_n[n], 2e-6 * c.force_n[n]) << d;
    }
  }
  const LayeredTouch layer({{0.04}, {1e4}, 0.49}, kRounded);
  for (const auto& [d, radius] : {std::pair{0.001, 2.9069e-3}, {0.002, 4.1606e-3}, {0.004, 5.9881e-3}})
    EXPECT_NEAR(layer.at(d).radius_m, radius, 1e-7) << d;
}

// What more of indentation adds is what a flat punch of the contact's size would.
TEST(LayeredTouch, IsAsStiffAsAFlatPunchOfItsRadius) {
  for (const auto& [depth, punch] : {std::pair{0.04, 118.26591}, {0.01, 175.16500}}) {
    const LayeredTouch touch({{depth}, {1e4}, 0.49}, kRounded);
    double low = 1e-4, high = 8e-3;
    while (high - low > 1e-12) {
      const double middle = (low + high) / 2;
      (touch.at(middle).radius_m < 0.004 ? low : high) = middle;
    }
    EXPECT_NEAR(touch.at(low).stiffness_n_m, punch, 5e-6 * punch) << depth;
  }
}

// Dimitriadis et al., Determination of elastic moduli of thin layers of soft material using the atomic force
// microscope, Biophys. J. 82, 2002: bonded, to the fourth power of sqrt(R d) / depth. Some 0.2 % low at 0.1.
TEST(LayeredTouch, IsTheSeriesOfThickLayersAtAnyPoissonRatio) {
  constexpr double kRatio = 0.1, kPi = std::numbers::pi, kModulusPa = 1e4, kIndentationM = 0.001;
  const double hertz_m = std::sqrt(kRounded.radius_m * kIndentationM);
  for (const double nu : {0.1, 0.3, 0.45, 0.4999}) {
    const double a = -(1.2876 - 1.4678 * nu + 1.3442 * nu * nu) / (1 - nu),
                 b = (0.6387 - 1.0277 * nu + 1.5164 * nu * nu) / (1 - nu);
    const double series =
        1 - 2 * a / kPi * kRatio + std::pow(2 * a / kPi * kRatio, 2) -
        8 / std::pow(kPi, 3) * (a * a * a + 4 * kPi * kPi / 15 * b) * std::pow(kRatio, 3) +
        16 * a / std::pow(kPi, 4) * (a * a * a + 3 * kPi * kPi / 5 * b) * std::pow(kRatio, 4);
    const double hertz_n = 4.0 / 3 * kModulusPa / (1 - nu * nu) * hertz_m * kIndentationM;
    const LayeredTouch unit({{hertz_m / kRatio}, {1}, nu}, kRounded);
    EXPECT_NEAR(unit.at(kIndentationM).times(kModulusPa).force_n / hertz_n, series, 0.004 * series) << nu;
  }
}

// So deep that it is a half space: Hertz, and the sphere's own force (Sneddon 1965).
TEST(LayeredTouch, OfDeepTissueIsHertzAndSneddon) {
  const LayerStack deep{{50}, {1e4}, 0.49};
  const double plane_pa = 1e4 / (1 - 0.49 * 0.49), radius = 0.008;
  const LayeredTouch paraboloid(deep, kRounded), sphere(deep, tip_of(FingertipShape::kSphere));
  for (const double d : {2e-5, 3e-4, 1e-3, 3e-3})
    EXPECT_NEAR(paraboloid.at(d).force_n / (4.0 / 3 * plane_pa * std::sqrt(radius * d) * d), 1, 3e-4) << d;
  for (const double a : {0.002, 0.005}) {
    const double d = a * std::atanh(a / radius);
    const double force = plane_pa * ((a * a + radius * radius) * std::atanh(a / radius) - a * radius);
    EXPECT_NEAR(sphere.at(d).force_n / force, 1, 5e-4) << a;
  }
}

TEST(LayeredTouch, EnergyForceAndStiffnessAreEachOthersDerivatives) {
  const LayeredTouch touch({{0.002, 0.006, 0.03}, {4e4, 8e3, 2e4}, 0.45}, kRounded);
  for (const double d : {2e-6, 5e-5, 1.03e-3, 2.8e-3}) {
    const double step = 1e-4 * d;
    const LayeredTouch::At at = touch.at(d), more = touch.at(d + step), less = touch.at(d - step);
    EXPECT_NEAR((more.energy_j - less.energy_j) / (2 * step), at.force_n, 1e-6 * at.force_n) << d;
    EXPECT_NEAR((more.force_n - less.force_n) / (2 * step), at.stiffness_n_m, 1e-6 * at.stiffness_n_m) << d;
  }
  EXPECT_EQ(touch.at(0).force_n, 0);
  EXPECT_EQ(touch.at(-1).force_n, 0);
  EXPECT_THROW(touch.at(1.01 * touch.max_m()), std::out_of_range);
}

// What cannot be solved is not in the table: a thin soft layer under a wide contact.
TEST(LayeredTouch, GrowsAndIsFiniteWhateverTheLayers) {
  LayerStack striped{std::vector<double>(60, 0.0002), std::vector<double>(60, 1e4), 0.3};
  for (std::size_t n = 0; n < 60; n += 2) striped.youngs_modulus_pa[n] = 1e3;
  for (const LayerStack& stack :
       {LayerStack{{0.0001, 0.02}, {1e4, 1e5}, 0.49}, LayerStack{{0.0005, 0.02}, {1e4, 1e6}, 0.4999},
        LayerStack{{0.001}, {1e4}, 0.49}, striped})
    for (const double radius : {0.0003, 0.008, 0.06}) {
      Fingertip tip = kRounded;
      tip.radius_m = radius;
      const LayeredTouch touch(stack, tip);
      double before = 0;
      for (double d = touch.max_m() / 200; d < touch.max_m(); d *= 1.1) {
        const LayeredTouch::At at = touch.at(d);
        EXPECT_GT(at.force_n, before) << radius << ' ' << d;
        EXPECT_TRUE(std::isfinite(at.force_n) && std::isfinite(at.energy_j) && at.stiffness_n_m > 0);
        before = at.force_n;
      }
    }
}

// As deep as tissue lets a finger of usual size.
TEST(LayeredTouch, KnowsDeepTouches) {
  EXPECT_GT(LayeredTouch({{0.04}, {1e4}, 0.49}, kRounded).max_m(), 0.03);
  EXPECT_GT(LayeredTouch({{0.04}, {1e4}, 0.49}, tip_of(FingertipShape::kSphere)).max_m(), 0.008);
}

TEST(LayeredTouch, KnowsFrictionlessRoundTipsAlone) {
  Fingertip stuck = kRounded;
  stuck.friction = Friction::kStuck;
  for (const Fingertip& tip : {stuck, tip_of(FingertipShape::kFlatPunch), tip_of(FingertipShape::kNode)}) {
    EXPECT_FALSE(round_and_frictionless(tip));
    EXPECT_THROW(LayeredTouch({{0.04}, {1e4}, 0.49}, tip), std::invalid_argument);
  }
}

class ExactLayers : public testing::Test {
 protected:
  static SolidTissue layers_and_ball(double contrast) {
    const SolidGrid grid{32, 32, 0.002, 0.002, graded_rows(0.020, 14, 1.05)};
    return solid(grid, 0.49, [=](double x, double y, double z) {
      const bool ball = std::hypot(x - 0.032, y - 0.008, z - 0.032) < 0.005;
      return (y < 0.006 ? 2e4 : 1e4) * (ball ? contrast : 1);
    });
  }
  Queue queue = test_device()->queue();
};

// Where tissue is layered nothing is left of the nodes: neither their size nor the ripple between them.
TEST_F(ExactLayers, OfLayeredTissueAreTheExactTouch) {
  const SolidTissue tissue = layers_and_ball(1);
  const SolidContact<float> contact(queue, tissue);
  LayerStack layers{{}, {}, 0.49};  // the boundary lies where the grid has it
  for (std::size_t j = 0; j < tissue.grid.layers(); ++j) {
    layers.thickness_m.push_back(tissue.grid.y_m[j + 1] - tissue.grid.y_m[j]);
    layers.youngs_modulus_pa.push_back(tissue.youngs_modulus_pa[j * tissue.grid.columns()]);
  }
  const LayeredTouch exact(layers, kRounded);
  for (const double d : {0.0008, 0.002, 0.003})
    for (const double aside : {0.0, 0.0004, 0.001}) {
      const Vector3 pose{0.03 + aside, d, 0.031};
      const ContactAnswer answer = contact.felt_answer(kRounded, pose);
      EXPECT_NEAR(-answer.force_n[1] / exact.at(d).force_n, 1, 1e-4);
      EXPECT_NEAR(answer.force_n[0] / answer.force_n[1], 0, 1e-5);
      const ContactAnswer beside = contact.felt_answer(kRounded, {0.0312, d, 0.0305});
      EXPECT_NEAR(answer.force_n[1] / beside.force_n[1], 1, 2e-5);
    }
}

TEST_F(ExactLayers, LeaveForceAndTangentDerivativesOfTheEnergy) {
  SolidContact<double> contact(queue, layers_and_ball(10));
  const Vector3 pose{0.0285, 0.0022, 0.0301};
  contact.touch(kRounded, pose);
  const ContactAnswer at = contact.felt_answer(kRounded, pose);
  constexpr double kStep = 2e-6;
  for (const std::size_t c : {0, 1, 2}) {
    Vector3 more = pose, less = pose;
    more[c] += kStep, less[c] -= kStep;
    const ContactAnswer above = contact.felt_answer(kRounded, more),
                        below = contact.felt_answer(kRounded, less);
    EXPECT_NEAR(-(above.energy_j - below.energy_j) / (2 * kStep), at.force_n[c],
                1e-5 * std::abs(at.force_n[1]));
    for (const std::size_t k : {0, 1, 2})
      EXPECT_NEAR((above.force_n[k] - below.force_n[k]) / (2 * kStep), at.tangent_n_m[3 * k + c],
                  1e-3 * std::abs(at.tangent_n_m[4]));
  }
  EXPECT_EQ(at.budget.relative(ErrorTerm::kSolver), at.solve.relative_error);
  const double strain = 2.2 / 8;
  EXPECT_NEAR(at.budget.relative(ErrorTerm::kFiniteStrain),
              (0.06 * std::sqrt(strain) + 0.025 * strain) / 1.96, 1e-12);
  double pressed_n = 0;
  for (const NodalPressure& p : at.pressure) pressed_n += p.pressure_pa * p.width_m[0] * p.width_m[1];
  EXPECT_NEAR(pressed_n / -at.force_n[1], 1,
              0.02);  // the skin's part of U changes with the depth, too (T8.6)
}

// Neither where a tip first meets a node, nor where it is deeper than the exact touch knows.
TEST_F(ExactLayers, LeaveNoStepInTheForce) {
  const SolidContact<double> contact(queue, layers_and_ball(1));
  Fingertip small = tip_of(FingertipShape::kSphere);
  small.radius_m = 0.004;
  const auto force = [&](const Fingertip& tip, double d) {
    return -contact.felt_answer(tip, {0.031, d, 0.031}).force_n[1];
  };
  const double deepest = LayeredTouch({{0.006, 0.014}, {2e4, 1e4}, 0.49}, small).max_m();
  EXPECT_NEAR(force(small, deepest * (1 + 1e-5)) / force(small, deepest * (1 - 1e-5)), 1, 1e-3);
  EXPECT_GT(force(small, 1.2 * deepest), force(small, deepest));
  for (double d = 0.00002; d < 0.0006; d *= 1.02)  // the first node is met at 0.125 mm
    EXPECT_NEAR(force(kRounded, 1.02 * d) / force(kRounded, d), std::pow(1.02, 1.5), 0.01) << d;
}

// Over a ball, on nodes 2 mm apart, against the same tissue on nodes 1 mm apart.
TEST_F(ExactLayers, TakeMostOfTheNodesErrorAway) {
  const auto tissue = [](double spacing) {
    const auto n = std::size_t(std::lround(0.064 / spacing));
    SolidGrid grid{n, n, spacing, spacing, {}};
    for (std::size_t j = 0; double(j) * spacing < 0.0201; ++j) grid.y_m.push_back(double(j) * spacing);
    return solid(grid, 0.49, [](double x, double y, double z) {  // of voxels of 2 mm, on any nodes
      const auto voxel = [](double at) { return 0.002 * std::floor(at / 0.002) + 0.001; };
      return std::hypot(voxel(x) - 0.032, voxel(y) - 0.009, voxel(z) - 0.032) < 0.005 ? 1e5 : 1e4;
    });
  };
  SolidContact<double> coarse(queue, tissue(0.002)), fine(queue, tissue(0.001));
  for (const double d : {0.001, 0.002}) {
    const Vector3 pose{0.0333, d, 0.0316};
    const double on_nodes = coarse.touch(kRounded, pose).force_n[1];
    fine.touch(kRounded, pose);
    const double truth = fine.felt_answer(kRounded, pose).force_n[1];
    const ContactAnswer answer = coarse.felt_answer(kRounded, pose);
    const double off = answer.force_n[1] / truth - 1;
    const double stated = answer.budget.relative(ErrorTerm::kMesh);
    EXPECT_LT(std::abs(off), 2 * stated) << d;
    EXPECT_LT(stated, 0.08) << d;
    EXPECT_LT(std::abs(off), 0.02) << d;
    EXPECT_LT(std::abs(off), 0.4 * std::abs(on_nodes / truth - 1)) << d;
  }
}

}  // namespace
}  // namespace teletact::service
