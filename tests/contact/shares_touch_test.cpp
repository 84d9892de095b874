// Round tips on solid tissue without nodes: what shares of the force say that they may be off by, against the
// solid.
#include "service/contact/shares_touch.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <memory>
#include <mutex>
#include <numbers>

#include "service/contact/solid_contact.h"
#include "tests/solver/block_stencil.h"
#include "tests/tissue/solid/solids.h"

namespace teletact::service {
namespace {

constexpr double kMiddleM = 0.032;
const Fingertip kTip;  // rounded, 8 mm

// 64 x 64 mm, 40 mm deep, 10 kPa times what is given.
SolidTissue tissue(const std::function<double(double x, double y, double z)>& contrast) {
  SolidGrid grid{32, 32, 0.002, 0.002, {}};
  for (std::size_t j = 0; j <= 20; ++j) grid.y_m.push_back(double(j) * 0.002);
  return solid(grid, 0.49, [&](double x, double y, double z) { return 1e4 * contrast(x, y, z); });
}
SolidTissue with_lump(double centre_m, double radius_m, double contrast) {
  return tissue([=](double x, double y, double z) {
    return std::hypot(x - kMiddleM, y - centre_m, z - kMiddleM) < radius_m ? contrast : 1;
  });
}
double layers(double, double y, double) {
  return y < 0.006 ? 2 : 1;
}

class Shares : public testing::Test {
 protected:
  std::shared_ptr<const SharesTouch> of(const SolidTissue& tissue) {
    contact = std::make_unique<SolidContact<float>>(queue, tissue);
    EXPECT_FALSE(contact->shares(kTip)) << "nothing is learned yet";
    contact->learn_shares(queue, solving);
    return contact->shares(kTip);
  }
  Queue queue = test_device()->queue();
  std::mutex solving;
  std::unique_ptr<SolidContact<float>> contact;
};

TEST_F(Shares, OfHomogeneousTissueAreTheExactLayer) {
  const auto shares = of(tissue([](double, double, double) { return 1; }));
  ASSERT_TRUE(shares);
  const Vector3 pose{0.03, 0.002, 0.033};
  EXPECT_LT(shares->over(pose, {}, FiniteStrain::kLeftOut), 0.1);
  const ContactAnswer answer = shares->answer(pose);
  EXPECT_EQ(answer.path, SolvePath::kShares);
  EXPECT_TRUE(answer.solve.converged);
  EXPECT_NEAR(-answer.force_n[1], 0.1581039, 2e-4 * 0.158);  // layered_touch_test
  EXPECT_LT(answer.budget.relative(ErrorTerm::kModel), 0.002);
  EXPECT_NEAR(answer.budget.relative(ErrorTerm::kFiniteStrain), (0.06 * 0.5 + 0.025 * 0.25) / 1.96, 1e-12);
  EXPECT_EQ(shares->answer({0.03, -0.001, 0.033}).state, ContactState::kNoContact);
}

// At a few percent, what a person who knows the tissue would say.
TEST_F(Shares, SayWhetherTheyAreGoodEnough) {
  const auto most = [this](const SolidTissue& tissue) { return of(tissue)->max_half_width(0.002); };
  EXPECT_LT(most(tissue(layers)), 0.01);
  EXPECT_LT(most(with_lump(0.024, 0.004, 5)), 0.01);
  EXPECT_LT(most(with_lump(0.0055, 0.0025, 3)), 0.05);
  EXPECT_GT(most(with_lump(0.005, 0.005, 30)), 0.05);
}

TEST_F(Shares, AreOffByNoMoreThanTheyState) {
  const auto lump_in_layers = [](double x, double y, double z) {
    return layers(x, y, z) * (std::hypot(x - kMiddleM, y - 0.008, z - kMiddleM) < 0.005 ? 6 : 1);
  };
  const auto shares = of(tissue(lump_in_layers));
  SolidContact<double> exact(queue, tissue(lump_in_layers));
  for (const double aside : {0.0, 0.003, 0.006, 0.012})
    for (const double d : {0.001, 0.003}) {
      const Vector3 pose{kMiddleM + aside, d, kMiddleM - aside / 2};
      exact.touch(kTip, pose);
      const ContactAnswer truth = exact.felt_answer(kTip, pose);
      const ContactAnswer answer = shares->answer(pose);
      const double lateral = answer.force_n[0] - truth.force_n[0],
                   across = answer.force_n[2] - truth.force_n[2], down = answer.force_n[1] - truth.force_n[1];
      const double off = std::hypot(lateral, down, across) / -truth.force_n[1];
      EXPECT_LE(off, shares->half_width(pose));
      EXPECT_LE(shares->half_width(pose), 1.02 * shares->max_half_width(d));
      EXPECT_LT(off, 0.06);
    }
}

// Where they fail they say so: against nodes 1 mm apart, which see the same voxels.
TEST_F(Shares, SayWhereTheyFail) {
  const auto ball = [](double x, double y, double z, double depth_m, double radius_m) {
    return std::hypot(x - kMiddleM, y - depth_m, z - kMiddleM) < radius_m;
  };
  const struct {
    const char* name;
    double poisson_ratio, depth_m, indentation_m;
    std::function<double(double, double, double)> contrast;
  } cases[] = {
      {"first touch over a lump", 0.49, 0.04, 0.0003,
       [&](double x, double y, double z) { return ball(x, y, z, 0.006, 0.005) ? 10 : 1; }},
      {"hard at the surface", 0.49, 0.04, 0.002,
       [&](double x, double y, double z) { return ball(x, y, z, 0.002, 0.006) ? 10 : 1; }},
      {"soft at the surface", 0.49, 0.04, 0.002,
       [&](double x, double y, double z) { return ball(x, y, z, 0.003, 0.005) ? 0.1 : 1; }},
      {"beside a hard one", 0.49, 0.04, 0.003,
       [&](double x, double y, double z) { return ball(x - 0.008, y, z, 0.004, 0.005) ? 30 : 1; }},
      {"two that overlap", 0.49, 0.04, 0.002,
       [&](double x, double y, double z) {
         return (ball(x, y, z, 0.008, 0.005) ? 5.0 : 1) * (ball(x + 0.003, y, z, 0.011, 0.006) ? 5 : 1);
       }},
      {"thin and nearly incompressible", 0.4999, 0.01, 0.002,
       [&](double x, double y, double z) { return ball(x, y, z, 0.006, 0.003) ? 5 : 1; }},
  };
  for (const auto& c : cases) {
    const auto cut = [&](double spacing_m) {
      const auto n = std::size_t(std::lround(0.064 / spacing_m));
      SolidGrid grid{n, n, spacing_m, spacing_m, {}};
      for (std::size_t j = 0; j <= std::size_t(std::lround(c.depth_m / spacing_m)); ++j)
        grid.y_m.push_back(double(j) * spacing_m);
      const auto voxel = [](double at_m) { return 0.002 * std::floor(at_m / 0.002) + 0.001; };
      return solid(grid, c.poisson_ratio, [&](double x, double y, double z) {
        return 1e4 * c.contrast(voxel(x), voxel(y), voxel(z));
      });
    };
    const Vector3 pose{kMiddleM, c.indentation_m, kMiddleM};
    SolidContact<double> fine(queue, cut(0.001));
    fine.touch(kTip, pose);
    const double truth = fine.felt_answer(kTip, pose).force_n[1];
    const auto shares = of(cut(0.002));
    const double off = std::abs(shares->answer(pose).force_n[1] / truth - 1);
    EXPECT_LE(off, shares->half_width(pose)) << c.name;
    EXPECT_TRUE(off <= 0.03 || shares->over(pose, {0.03, 0}, FiniteStrain::kLeftOut) > 1) << c.name;
  }
}

TEST_F(Shares, FeelStrainAsTheNodesDo) {
  const auto shares = of(tissue([](double, double, double) { return 1; }));
  const Vector3 pose{0.032, 0.002, 0.032};
  const double on_nodes = contact->felt_answer(kTip, pose).largest_strain;
  EXPECT_NEAR(shares->answer(pose).largest_strain / on_nodes, 1, 0.15);
}

// Whatever the tip, thin tissue, a stiff skin: finite, stated, or nothing is known.
TEST_F(Shares, OfAnyTipAreFiniteOrUnknown) {
  const auto skin = [](double, double y, double) { return y < 0.002 ? 2000.0 : 1; };
  for (const bool skinned : {false, true}) {
    of(skinned ? tissue(skin) : with_lump(0.008, 0.005, 4));
    for (const FingertipShape shape : {FingertipShape::kRoundedTip, FingertipShape::kSphere})
      for (const double radius_m : {0.0001, 0.0005, 0.001, 0.002, 0.008, 0.014, 0.03}) {
        Fingertip tip;
        tip.shape = shape, tip.radius_m = radius_m;
        const auto shares = contact->shares(tip);
        if (!shares) continue;
        EXPECT_GT(shares->max_m(), 0);
        for (const double share : {1e-3, 0.1, 0.7, 1.0}) {
          const Vector3 pose{kMiddleM, share * shares->max_m(), kMiddleM};
          const ContactAnswer answer = shares->answer(pose);
          EXPECT_LT(answer.force_n[1], 0) << radius_m;
          EXPECT_TRUE(std::isfinite(answer.force_n[1]) && std::isfinite(answer.tangent_n_m[4]));
          EXPECT_GT(answer.budget.relative(ErrorTerm::kModel), 0);
          EXPECT_GT(shares->over(pose, {}, FiniteStrain::kCounts), 0);
          EXPECT_GT(shares->max_half_width(pose[1]), 0);
        }
      }
  }
  EXPECT_TRUE(contact->shares(kTip) == nullptr || contact->shares(kTip)->max_m() <= 0.01);
}

// Newtons that are allowed are of the force that is felt, not of the layers'; and what finite strain takes of
// an allowance is not there for the model.
TEST_F(Shares, WhatIsAllowedIsOfTheForceThatIsFelt) {
  const auto shares = of(with_lump(0.0055, 0.0045, 20));
  const Vector3 over{kMiddleM, 0.001, kMiddleM};
  const double force = -shares->answer(over).force_n[1];
  const double off_n = shares->half_width(over) * force;
  EXPECT_GT(force, 0.065) << "the layers' is 0.05";
  EXPECT_NEAR(shares->over(over, {0, 0.01}, FiniteStrain::kLeftOut), off_n / 0.01, 1e-6);
  const Tolerance tolerance{0.03, 0};
  const double strain = 0.06 / std::sqrt(8) + 0.025 / 8;
  EXPECT_NEAR(shares->over(over, tolerance, FiniteStrain::kCounts) /
                  shares->over(over, tolerance, FiniteStrain::kLeftOut),
              0.03 / std::sqrt(0.03 * 0.03 - strain * strain), 1e-6);
}

// Solved with another's factor: of its own modulus all the same.
TEST_F(Shares, OfAnotherModulusAreItsOwn) {
  const auto before = of(with_lump(0.008, 0.005, 4));
  SolidTissue harder = with_lump(0.008, 0.005, 4);
  for (double& e : harder.youngs_modulus_pa) e *= 1.5;
  SolidContact<float> next(queue, *contact, harder);
  EXPECT_FALSE(next.shares(kTip));
  next.learn_shares(queue, solving);
  const Vector3 pose{0.03, 0.002, 0.033};
  const ContactAnswer one = before->answer(pose), other = next.shares(kTip)->answer(pose);
  EXPECT_NEAR(other.force_n[1] / one.force_n[1], 1.5, 1e-3);
  EXPECT_NEAR(other.energy_j / one.energy_j, 1.5, 1e-3);
  EXPECT_NEAR(other.tangent_n_m[4] / one.tangent_n_m[4], 1.5, 1e-3);
}

TEST_F(Shares, AreOfFrictionlessRoundTipsOnTheSurface) {
  of(with_lump(0.008, 0.005, 4));
  Fingertip punch, stuck;
  punch.shape = FingertipShape::kFlatPunch;
  stuck.friction = Friction::kStuck;
  EXPECT_FALSE(contact->shares(punch));
  EXPECT_FALSE(contact->shares(stuck));
  SolidContact<float> below(*contact, 3);
  below.learn_shares(queue, solving);
  EXPECT_FALSE(below.shares(kTip));
  EXPECT_THROW(contact->shares(kTip)->answer({0.03, 1, 0.03}), std::out_of_range);
}

}  // namespace
}  // namespace teletact::service
