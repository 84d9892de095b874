// A fingertip on solid tissue: against the exact theory of layers, against a sparse factor, its derivatives,
// and what it states that it is off by.
#include "service/contact/solid_contact.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "service/contact/fingertip.h"
#include "tests/reference/solid.h"
#include "tests/solver/block_stencil.h"
#include "tests/tissue/solid/solids.h"

namespace teletact::service {
namespace {

// A ball of contrast 10 in a block of 64 x 64 x 40 mm, 2 mm columns, its centre 12 mm deep in the middle.
constexpr double kMiddle = 0.032;
SolidTissue with_ball(double nu = 0.49) {
  return solid({32, 32, 0.002, 0.002, graded_rows(0.040, 12, 1.06)}, nu, [](double x, double y, double z) {
    return std::hypot(x - kMiddle, y - 0.012, z - kMiddle) < 0.008 ? 1e5 : 1e4;
  });
}

Queue queue() {
  return test_device()->queue();
}
bool has_double() {
  return queue().supports(Precision::kDouble);
}

constexpr Fingertip kRound{};
constexpr Fingertip kStuckRound{.friction = Friction::kStuck};
constexpr Fingertip kSphere{.shape = FingertipShape::kSphere};
constexpr Fingertip kPunch{.shape = FingertipShape::kFlatPunch, .radius_m = 0.002, .half_width_m = 0.004};
constexpr Fingertip kPad{
    .shape = FingertipShape::kPad, .radius_m = 0.002, .half_width_m = 0.005, .pad_m_pa = 1e-7};
constexpr Fingertip kStuckPad{.shape = FingertipShape::kPad,
                              .friction = Friction::kStuck,
                              .radius_m = 0.002,
                              .half_width_m = 0.005,
                              .pad_m_pa = 1e-7};

// Forces of a paraboloid of 8 mm on a bonded layer of 40 mm, 10 kPa, nu 0.49, by the Fredholm equation of the
// exact layer: it knows neither elements nor a period.
TEST(SolidContact, OnAHomogeneousLayerItIsTheExactOnes) {
  if (!has_double()) GTEST_SKIP() << "the device has no double";
  const SolidTissue tissue = solid({64, 64, 0.001, 0.001, graded_rows(0.040, 32, 1.04)}, 0.49,
                                   [](double, double, double) { return 1e4; });
  SolidContact<double> contact(queue(), tissue);
  for (const auto& [depth, force, tolerance] :
       {std::tuple{0.001, 0.0538890, 0.02}, std::tuple{0.002, 0.1581039, 0.006},
        std::tuple{0.004, 0.4721386, 0.003}}) {
    double mean = 0, low = HUGE_VAL, high = 0;
    for (const double x : {0.0, 0.00025, 0.0005})
      for (const double z : {0.0, 0.00025, 0.0005}) {
        const double f = -contact.touch(kRound, {kMiddle + x, depth, kMiddle + z}).force_n[1];
        mean += f / 9;
        low = std::min(low, f);
        high = std::max(high, f);
      }
    EXPECT_NEAR(mean, force, tolerance * force) << depth;
    EXPECT_LT(high - low, 0.002 * mean) << "ripple of the mesh at " << depth;
  }
  EXPECT_EQ(contact.corrections(), 0u) << "layered tissue needs none";
}

// Shares by exact layers that slide on their ground, nu 0.49; and by nodes.
TEST(SolidContact, WhereItSlidesItLosesWhatIsStated) {
  if (!has_double()) GTEST_SKIP() << "the device has no double";
  const Fingertip tip;
  constexpr double kIndentationM = 0.002, kContactM = 0.004;
  for (const auto& [of_depth, lost] : {std::pair{0.1, 0.0402}, {0.2, 0.0879}, {0.4, 0.1998}})
    EXPECT_NEAR(lost_by_sliding(tip, kIndentationM, kContactM / of_depth), lost, 0.01) << of_depth;
  const auto felt_n = [&](bool slides) {
    SolidGrid grid{64, 64, 0.001, 0.001, {}, slides};
    for (std::size_t j = 0; j <= (slides ? 21 : 20); ++j) grid.y_m.push_back(double(j) * 0.001);
    SolidContact<double> contact(queue(), solid(grid, 0.49, [](double, double, double) { return 1e4; }));
    return -contact.touch(tip, {0.032, kIndentationM, 0.032}).force_n[1];
  };
  EXPECT_NEAR(1 - felt_n(true) / felt_n(false), 0.0879, 0.01);
}

// On a half space a sphere that is pressed as deep as its paraboloid is felt less, exactly so (Sneddon 1965):
// d = a artanh(a / R), F ~ (a^2 + R^2) artanh(a / R) - a R where the paraboloid has 4/3 sqrt(R) d^1.5. By
// extrapolation from two meshes, 1 mm on a layer of 40 mm and 0.5 on one of 80: what is wrong with either
// goes with the mesh and with one over the layer.
TEST(SolidContact, ASphereIsFeltLessThanItsParaboloid) {
  if (!has_double()) GTEST_SKIP() << "the device has no double";
  const auto ratios = [](std::size_t columns) {
    const double h = 2 * kMiddle / double(columns);
    const SolidTissue tissue =
        solid({columns, columns, h, h, graded_rows(0.040 * double(columns) / 64, 25, 1.1)}, 0.49,
              [](double, double, double) { return 1e4; });
    SolidContact<double> contact(queue(), tissue);
    std::vector<double> out;
    for (const double depth : {0.002, 0.004}) {
      double sphere = 0, round = 0;  // over a node, amid four, and between: the mesh's ripple
      for (const double x : {0.0, h / 2})
        for (const double z : {0.0, h / 2}) {
          sphere += contact.touch(kSphere, {kMiddle + x, depth, kMiddle + z}).force_n[1];
          round += contact.touch(kRound, {kMiddle + x, depth, kMiddle + z}).force_n[1];
        }
      out.push_back(sphere / round);
    }
    return out;
  };
  const std::vector<double> coarse = ratios(64), fine = ratios(128);
  for (const std::size_t k : {0U, 1U}) {
    const double depth = 0.25 * double(k + 1);  // over the radius
    double t = 0.5;                             // a / R
    for (int n = 0; n < 50; ++n) t -= (t * std::atanh(t) - depth) / (std::atanh(t) + t / (1 - t * t));
    const double exact = ((t * t + 1) * std::atanh(t) - t) / (4.0 / 3 * std::pow(depth, 1.5));
    EXPECT_LT(exact, 0.98);
    EXPECT_NEAR(2 * fine[k] - coarse[k], exact, 0.004) << depth;
  }
}

// Beyond 0.9 of its radius a sphere's side goes on smoothly: far nodes of a deep touch have an overlap, too.
TEST(SolidContact, ASpheresSideHasNoEnd) {
  for (const double r : {0.001, 0.0071, 0.00719, 0.00721, 0.009, 0.02}) {
    const double h = 1e-6;
    const Rise at = rise(kSphere, r), before = rise(kSphere, r - h), after = rise(kSphere, r + h);
    EXPECT_NEAR((after.m - before.m) / (2 * h), at.slope, 1e-5 * at.slope) << r;
    EXPECT_NEAR((after.slope - before.slope) / (2 * h), at.curvature_1_m, 1e-3 * at.curvature_1_m) << r;
    EXPECT_NEAR(reach_m(kSphere, at.m, 0), r, 1e-9) << r;
  }
}

// What the skins bear is what they carry: with the sparse factor's compliance every node is where its
// pressure says that it is.
TEST(SolidContact, TheTissueIsWhereTheSparseFactorPutsIt) {
  if (!has_double()) GTEST_SKIP() << "the device has no double";
  const SolidTissue tissue = lump_in_waves();
  const SolidGrid& grid = tissue.grid;
  SolidContact<double> contact(queue(), tissue);
  const Vector3 pose{0.0312, 0.0018, 0.0193};
  const double area = grid.spacing_x_m * grid.spacing_z_m;
  // The truth's block is periodic; what the wider surface gives beyond that is the layered tissue's.
  const LayeredTissue layers = layered(tissue);
  const SurfaceCompliance wide = wide_surface(grid, layers, 0.49, choices::kMinPeriod * 0.020);
  const SurfaceCompliance periodic = wide_surface(grid, layers, 0.49, 0);
  const reference::SolidReference truth(tissue);
  for (const Fingertip& tip : {kRound, kPad}) {
    const ContactAnswer answer = contact.touch(tip, pose, {.force_error = 1e-8});
    EXPECT_GT(contact.corrections(), 0u);
    std::vector<std::size_t> nodes;
    Eigen::VectorXd p(Eigen::Index(answer.pressure.size()));
    for (const NodalPressure& node : answer.pressure) {
      const auto i = std::size_t(std::lround(node.position_m[0] / grid.spacing_x_m));
      const auto k = std::size_t(std::lround(node.position_m[2] / grid.spacing_z_m));
      p[Eigen::Index(nodes.size())] = node.pressure_pa * area;
      nodes.push_back(reference::unknown(grid, i, 0, k, 1));
    }
    const Eigen::VectorXd moved = (truth.compliance(nodes) + wide.among(nodes) - periodic.among(nodes)) * p;
    const SkinThickness skin = skin_thickness(tip, pose[1], std::sqrt(area));
    const bool pad = tip.shape == FingertipShape::kPad;
    for (std::size_t n = 0; n < nodes.size(); ++n) {
      const Vector3& at = answer.pressure[n].position_m;
      const double r = std::hypot(at[0] - pose[0], at[2] - pose[2]);
      const double beyond = std::max(0.0, r - (pad ? tip.half_width_m : 0));
      const double given = pad ? tip.pad_m_pa * answer.pressure[n].pressure_pa : 0;
      const SkinState state = skin_state(p[Eigen::Index(n)], kSkinStiffness / wide(1, 1, 0, 0), skin.t_m);
      EXPECT_NEAR(moved[Eigen::Index(n)],
                  pose[1] - beyond * beyond / (2 * tip.radius_m) + state.gap_m - given, 1e-6 * pose[1])
          << n;
    }
  }
}

TEST(SolidContact, ForceAndTangentAreTheEnergysDerivatives) {
  if (!has_double()) GTEST_SKIP() << "the device has no double";
  SolidContact<double> contact(queue(), with_ball());
  const SolidContactOptions exact{.force_error = 1e-7};
  for (const Fingertip& tip : {kRound, kStuckRound, kPunch, kPad, kStuckPad, kSphere}) {
    const Vector3 pose{kMiddle + 0.0043, 0.0021, kMiddle - 0.0027};
    const ContactAnswer answer = contact.touch(tip, pose, exact);
    const double size = std::abs(answer.force_n[1]), stiff = std::abs(answer.tangent_n_m[4]);
    for (std::size_t c = 0; c < 3; ++c) {
      constexpr double kStep = 2e-5;
      Vector3 after = pose, before = pose;
      after[c] += kStep;
      before[c] -= kStep;
      const ContactAnswer a = contact.touch(tip, after, exact), b = contact.touch(tip, before, exact);
      EXPECT_NEAR(answer.force_n[c], -(a.energy_j - b.energy_j) / (2 * kStep), 1e-3 * size);
      for (std::size_t d = 0; d < 3; ++d) {
        EXPECT_NEAR(answer.tangent_n_m[3 * d + c], (a.force_n[d] - b.force_n[d]) / (2 * kStep), 0.02 * stiff)
            << "dF" << d << "/d" << c;
        EXPECT_DOUBLE_EQ(answer.tangent_n_m[3 * d + c], answer.tangent_n_m[3 * c + d]);
      }
    }
  }
}

TEST(SolidContact, DoesNotDependOnWhatWasTouchedBefore) {
  if (!has_double()) GTEST_SKIP() << "the device has no double";
  const SolidTissue tissue = with_ball();
  const SolidContactOptions exact{.force_error = 1e-7};
  for (const Fingertip& tip : {kRound, kStuckRound}) {
    SolidContact<double> travelled(queue(), tissue), fresh(queue(), tissue);
    for (const double x : {-0.010, -0.004, 0.002, 0.0035})
      travelled.touch(tip, {kMiddle + x, 0.0025, kMiddle}, exact);
    const Vector3 pose{kMiddle + 0.003, 0.002, kMiddle + 0.001};
    const ContactAnswer a = travelled.touch(tip, pose, exact), b = fresh.touch(tip, pose, exact);
    for (std::size_t c = 0; c < 3; ++c)
      EXPECT_NEAR(a.force_n[c], b.force_n[c], 1e-6 * std::abs(b.force_n[1])) << c;
  }
}

TEST(SolidContact, IsTheSameMirroredAndTurned) {
  SolidContact<float> contact(queue(), with_ball());
  const double asked = 5e-4;
  const auto at = [&](double x, double z) {
    return contact.touch(kRound, {kMiddle + x, 0.002, kMiddle + z}, {.force_error = asked}).force_n;
  };
  const Vector3 f = at(0.006, 0.002), mirrored = at(-0.006, 0.002), turned = at(0.002, 0.006);
  const double tolerance = 2 * asked * std::abs(f[1]);
  EXPECT_GT(std::abs(f[0]), 10 * tolerance) << "the ball pushes sideways";
  EXPECT_NEAR(f[0], -mirrored[0], tolerance);
  EXPECT_NEAR(f[1], mirrored[1], tolerance);
  EXPECT_NEAR(f[0], turned[2], tolerance);
  EXPECT_NEAR(f[2], turned[0], tolerance);
}

// A finger travels over the ball; corrected when it is asked to be. What it states is about what it is off
// by.
TEST(SolidContact, StatesWhatItIsOffBy) {
  if (!has_double()) GTEST_SKIP() << "the device has no double";
  const SolidTissue tissue = with_ball();
  SolidContact<double> exact(queue(), tissue);
  for (const double asked : {choices::kSolidForceError, 0.02}) {
    SolidContact<float> contact(queue(), tissue);
    std::size_t touches = 0, covered = 0;
    std::vector<double> ratio;
    for (double x = -0.016; x < 0.016; x += 0.0009, ++touches) {
      const Vector3 pose{kMiddle + x, 0.002 + 0.0005 * std::sin(300 * x),
                         kMiddle + 0.003 * std::sin(200 * x)};
      const ContactAnswer a = contact.touch(kRound, pose, {.force_error = asked});
      const ContactAnswer b = exact.touch(kRound, pose, {.force_error = 1e-6});
      EXPECT_LE(a.solve.relative_error, asked);
      const Eigen::Vector3d f(a.force_n.data()), truth(b.force_n.data());
      const double error = (f - truth).norm() / truth.norm();
      covered += error <= a.solve.relative_error;
      ratio.push_back(a.solve.relative_error / error);
    }
    std::ranges::nth_element(ratio, ratio.begin() + long(ratio.size() / 2));
    EXPECT_GE(covered, touches - touches / 20) << asked;
    EXPECT_LT(ratio[ratio.size() / 2], 20) << asked;
    EXPECT_LT(contact.corrections(), 2 * touches);
  }
}

TEST(SolidContact, FailsWithAnAnswerThatSaysSo) {
  SolidContact<float> contact(queue(), with_ball());
  const ContactAnswer early =
      contact.touch(kRound, {kMiddle, 0.002, kMiddle}, {.force_error = 1e-3, .max_corrections = 0});
  EXPECT_FALSE(early.solve.converged);
  EXPECT_GT(early.solve.relative_error, 0.05) << "the layered guess is far off over a ball";
  EXPECT_STREQ(early.solve.reason, "correction limit");
  EXPECT_EQ(contact.touch(kRound, {kMiddle, 0, kMiddle}).state, ContactState::kNoContact);
  EXPECT_THROW(contact.touch(kRound, {kMiddle, 0.041, kMiddle}), std::invalid_argument);
  EXPECT_THROW(contact.touch(kRound, {NAN, 0.001, kMiddle}), std::invalid_argument);
  EXPECT_THROW(contact.touch({.radius_m = 0.5}, {kMiddle, 0.002, kMiddle}), std::out_of_range);
}

// Before anything was learned: S0 scaled by shares of energy is nearer to the truth, whatever lies below, and
// exactly S0 where nothing does.
TEST(SolidContact, TheGuessKnowsWhatLiesBelow) {
  if (!has_double()) GTEST_SKIP() << "the device has no double";
  const SolidGrid grid{32, 32, 0.002, 0.002, graded_rows(0.040, 12, 1.06)};
  const auto ball = [](double x, double y, double z, double deep, double aside) {
    return std::hypot(x - kMiddle - aside, y - deep, z - kMiddle) < 0.006;
  };
  const std::vector<std::function<double(double, double, double)>> tissues{
      [&](double x, double y, double z) { return ball(x, y, z, 0.007, 0) ? 1e5 : 1e4; },
      [&](double x, double y, double z) { return ball(x, y, z, 0.012, 0) ? 1e5 : 1e4; },
      [&](double x, double y, double z) { return ball(x, y, z, 0.009, 0) ? 1e3 : 1e4; },
      [&](double x, double y, double z) {
        return 1e4 * (ball(x, y, z, 0.010, 0.008) ? 6 : 1) * (ball(x, y, z, 0.008, -0.008) ? 0.3 : 1);
      }};
  for (std::size_t n = 0; n < tissues.size(); ++n) {
    const SolidTissue tissue = solid(grid, 0.49, tissues[n]);
    SolidContact<double> contact(queue(), tissue);
    SolidContact<double> unfelt(queue(), contact, tissue);  // that has corrected nothing yet
    double guessed = 0, layered = 0;                        // squares of errors
    for (const double x : {0.0, 0.006, -0.009}) {
      const Vector3 pose{kMiddle + x, 0.002, kMiddle};
      SolidContact<double> exact(queue(), contact, tissue);
      const double truth = exact.touch(kRound, pose, {.force_error = 1e-4}).force_n[1];
      guessed += std::pow(contact.answer(kRound, pose).force_n[1] / truth - 1, 2);
      layered += std::pow(unfelt.answer(kRound, pose).force_n[1] / truth - 1, 2);
    }
    EXPECT_LT(std::sqrt(guessed), 0.6 * std::sqrt(layered)) << n;
    std::printf("tissue %zu: the guess is off by %.3f, layered tissue by %.3f\n", n, std::sqrt(guessed / 3),
                std::sqrt(layered / 3));
  }
  const SolidTissue layers = solid(grid, 0.49, [](double, double y, double) { return 1e4 * (1 + 50 * y); });
  SolidContact<double> contact(queue(), layers), unfelt(queue(), contact, layers);
  const Vector3 pose{kMiddle, 0.002, kMiddle};
  EXPECT_EQ(contact.answer(kRound, pose).force_n, unfelt.answer(kRound, pose).force_n);
  EXPECT_TRUE(contact.answer(kRound, pose).solve.converged);
}

// Another modulus on the same factor: each is felt as if it were alone, and what one has learned is not the
// other's. Of the factor's E0 the shape is left in the skin and the period's share: one made anew differs by
// a little.
TEST(SolidContact, AnotherModulusOnTheSameFactorIsFeltAsItsOwn) {
  if (!has_double()) GTEST_SKIP() << "the device has no double";
  const SolidTissue with = with_ball();
  SolidTissue without = with;
  for (double& e : without.youngs_modulus_pa) e = std::min(e, 2e4);
  const SolidContactOptions exact{.force_error = 1e-7};
  const Vector3 pose{kMiddle + 0.002, 0.002, kMiddle};
  SolidContact<double> old(queue(), with);
  const double before = -old.touch(kRound, pose, exact).force_n[1];
  SolidContact<double> next(queue(), old, without), fresh(queue(), without);
  const double after = -next.touch(kRound, pose, exact).force_n[1];
  EXPECT_GT(next.corrections(), 0u) << "learned anew";
  EXPECT_LT(after, 0.95 * before);
  EXPECT_NEAR(after, -fresh.touch(kRound, pose, exact).force_n[1], 2e-3 * after);
  const std::size_t learned = old.corrections();
  EXPECT_NEAR(-old.touch(kRound, pose, exact).force_n[1], before, 1e-7 * before) << "the old one goes on";
  EXPECT_EQ(old.corrections(), learned);
}

}  // namespace
}  // namespace teletact::service
