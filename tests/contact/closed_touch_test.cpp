// Round tips on solid tissue without nodes: what each closed form says that it may be off by, against the
// solid.
#include "service/contact/closed_touch.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <numbers>

#include "service/contact/solid_contact.h"
#include "tests/solid/solids.h"
#include "tests/solver/block_stencil.h"

namespace teletact::service {
namespace {

constexpr double kMiddleM = 0.032;
const Fingertip kTip;  // rounded, 8 mm
constexpr SolvePath kAll[] = {SolvePath::kLayer, SolvePath::kLayers, SolvePath::kShares};

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

class ClosedTouches : public testing::Test {
 protected:
  std::shared_ptr<const ClosedTouch> of(const SolidTissue& tissue) {
    contact = std::make_unique<SolidContact<float>>(queue, tissue);
    EXPECT_FALSE(contact->closed(kTip)) << "nothing is learned yet";
    contact->learn_shares(queue, solving);
    return contact->closed(kTip);
  }
  static double most_over(const ClosedTouch& closed, SolvePath path, const Tolerance& tolerance) {
    return closed.most_over(path, tolerance, FiniteStrain::kLeftOut);
  }
  Queue queue = test_device()->queue();
  std::mutex solving;
  std::unique_ptr<SolidContact<float>> contact;
};

TEST_F(ClosedTouches, OfHomogeneousTissueAreTheExactLayer) {
  const auto closed = of(tissue([](double, double, double) { return 1; }));
  ASSERT_TRUE(closed);
  EXPECT_NEAR(closed->modulus_pa(), 1e4, 5);
  for (const SolvePath path : kAll) {
    EXPECT_LT(most_over(*closed, path, {}), 0.1);
    const ContactAnswer answer = closed->answer(path, {0.03, 0.002, 0.033});
    EXPECT_EQ(answer.path, path);
    EXPECT_TRUE(answer.solve.converged);
    EXPECT_NEAR(-answer.force_n[1], 0.1581039, 2e-4 * 0.158);  // layered_touch_test
    EXPECT_LT(answer.budget.relative(ErrorTerm::kModel), 0.002);
    EXPECT_NEAR(answer.budget.relative(ErrorTerm::kFiniteStrain), 0.0125, 1e-12);
    EXPECT_EQ(closed->answer(path, {0.03, -0.001, 0.033}).state, ContactState::kNoContact);
  }
}

// What each is good enough for, at a few percent, is what a person who knows the tissue would say.
TEST_F(ClosedTouches, SayWhatEachTissueNeeds) {
  const Tolerance tenth{0.1, 0}, twentieth{0.05, 0};
  const auto deep = of(with_lump(0.024, 0.004, 5));
  EXPECT_LE(most_over(*deep, SolvePath::kLayer, tenth), 1);
  const auto layered = of(tissue(layers));
  EXPECT_GT(most_over(*layered, SolvePath::kLayer, twentieth), 1);
  EXPECT_LE(most_over(*layered, SolvePath::kLayers, twentieth), 1);
  const auto shallow = of(with_lump(0.0055, 0.0025, 3));
  EXPECT_GT(most_over(*shallow, SolvePath::kLayers, twentieth), 1);
  EXPECT_LE(most_over(*shallow, SolvePath::kShares, twentieth), 1);
  const auto hard = of(with_lump(0.005, 0.005, 30));
  EXPECT_GT(most_over(*hard, SolvePath::kShares, twentieth), 1);
}

TEST_F(ClosedTouches, AreOffByNoMoreThanTheyState) {
  const auto lump_in_layers = [](double x, double y, double z) {
    return layers(x, y, z) * (std::hypot(x - kMiddleM, y - 0.008, z - kMiddleM) < 0.005 ? 6 : 1);
  };
  const auto closed = of(tissue(lump_in_layers));
  SolidContact<double> exact(queue, tissue(lump_in_layers));
  int missed = 0;
  for (const double aside : {0.0, 0.003, 0.006, 0.012})
    for (const double d : {0.001, 0.003}) {
      const Vector3 pose{kMiddleM + aside, d, kMiddleM - aside / 2};
      exact.touch(kTip, pose);
      const ContactAnswer truth = exact.felt_answer(kTip, pose);
      std::map<SolvePath, double> off;
      for (const SolvePath path : kAll) {
        const ContactAnswer answer = closed->answer(path, pose);
        const double lateral = answer.force_n[0] - truth.force_n[0],
                     across = answer.force_n[2] - truth.force_n[2],
                     down = answer.force_n[1] - truth.force_n[1];
        double& own = off[path];
        own = std::hypot(lateral, down, across) / -truth.force_n[1];
        missed += own > closed->half_width(path, pose) ? 1 : 0;
        EXPECT_LE(closed->half_width(path, pose), 1.02 * closed->most_half_width(path, d));
      }
      EXPECT_LT(off[SolvePath::kShares], 0.06);
      EXPECT_LT(off[SolvePath::kShares], off[SolvePath::kLayer]);
    }
  EXPECT_EQ(missed, 0);
}

// Where they fail they say so: against nodes 1 mm apart, which see the same voxels.
TEST_F(ClosedTouches, SayWhereTheyFail) {
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
    const auto closed = of(cut(0.002));
    for (const SolvePath path : kAll) {
      const double off = std::abs(closed->answer(path, pose).force_n[1] / truth - 1);
      EXPECT_LE(off, closed->half_width(path, pose)) << c.name << ", " << int(path);
      EXPECT_TRUE(off <= 0.03 || closed->over(path, pose, {0.03, 0}, FiniteStrain::kLeftOut) > 1)
          << c.name << ", " << int(path);
    }
  }
}

TEST_F(ClosedTouches, FeelStrainAsTheNodesDo) {
  const SolidTissue soft = tissue([](double, double, double) { return 1; });
  const auto closed = of(soft);
  const Vector3 pose{0.032, 0.002, 0.032};
  const double on_nodes = contact->felt_answer(kTip, pose).largest_strain;
  EXPECT_NEAR(closed->answer(SolvePath::kLayer, pose).largest_strain / on_nodes, 1, 0.15);
}

// Whatever the tip, thin tissue, a stiff skin: finite, stated, or nothing is known.
TEST_F(ClosedTouches, OfAnyTipAreFiniteOrUnknown) {
  const auto skin = [](double, double y, double) { return y < 0.002 ? 2000.0 : 1; };
  for (const bool skinned : {false, true}) {
    of(skinned ? tissue(skin) : with_lump(0.008, 0.005, 4));
    for (const FingertipShape shape : {FingertipShape::kRoundedTip, FingertipShape::kSphere})
      for (const double radius_m : {0.0001, 0.0005, 0.001, 0.002, 0.008, 0.014, 0.03}) {
        Fingertip tip;
        tip.shape = shape, tip.radius_m = radius_m;
        const auto closed = contact->closed(tip);
        if (!closed) continue;
        EXPECT_GT(closed->most_m(), 0);
        EXPECT_GT(closed->modulus_pa(), 0);
        for (const double share : {1e-3, 0.1, 0.7, 1.0})
          for (const SolvePath path : kAll) {
            const Vector3 pose{kMiddleM, share * closed->most_m(), kMiddleM};
            const ContactAnswer answer = closed->answer(path, pose);
            EXPECT_LT(answer.force_n[1], 0) << radius_m;
            EXPECT_TRUE(std::isfinite(answer.force_n[1]) && std::isfinite(answer.tangent_n_m[4]));
            EXPECT_GT(answer.budget.relative(ErrorTerm::kModel), 0);
            EXPECT_GT(closed->over(path, pose, {}, FiniteStrain::kCounts), 0);
            EXPECT_GT(closed->most_over(path, {}, FiniteStrain::kCounts), 0);
          }
      }
  }
  EXPECT_TRUE(contact->closed(kTip) == nullptr || contact->closed(kTip)->most_m() <= 0.01);
}

// Newtons that are allowed are of the force that is felt, not of the layers'; and what finite strain takes of
// an allowance is not there for the model.
TEST_F(ClosedTouches, WhatIsAllowedIsOfTheForceThatIsFelt) {
  const auto closed = of(with_lump(0.0055, 0.0045, 20));
  const Vector3 over{kMiddleM, 0.001, kMiddleM};
  const double force = -closed->answer(SolvePath::kShares, over).force_n[1];
  const double off_n = closed->half_width(SolvePath::kShares, over) * force;
  EXPECT_GT(force, 0.065) << "the layers' is 0.05";
  EXPECT_NEAR(closed->over(SolvePath::kShares, over, {0, 0.01}, FiniteStrain::kLeftOut), off_n / 0.01, 1e-6);
  const Tolerance tolerance{0.03, 0};
  const double strain = 1.96 * 0.05 / 8;
  EXPECT_NEAR(closed->over(SolvePath::kShares, over, tolerance, FiniteStrain::kCounts) /
                  closed->over(SolvePath::kShares, over, tolerance, FiniteStrain::kLeftOut),
              0.03 / std::sqrt(0.03 * 0.03 - strain * strain), 1e-6);
}

// Solved with another's factor: of its own modulus all the same.
TEST_F(ClosedTouches, OfAnotherModulusAreItsOwn) {
  const auto before = of(with_lump(0.008, 0.005, 4));
  SolidTissue harder = with_lump(0.008, 0.005, 4);
  for (double& e : harder.youngs_modulus_pa) e *= 1.5;
  SolidContact<float> next(queue, *contact, harder);
  EXPECT_FALSE(next.closed(kTip));
  next.learn_shares(queue, solving);
  const auto closed = next.closed(kTip);
  for (const SolvePath path : kAll) {
    const Vector3 pose{0.03, 0.002, 0.033};
    const ContactAnswer one = before->answer(path, pose), other = closed->answer(path, pose);
    EXPECT_NEAR(other.force_n[1] / one.force_n[1], 1.5, 1e-3);
    EXPECT_NEAR(other.energy_j / one.energy_j, 1.5, 1e-3);
    EXPECT_NEAR(other.tangent_n_m[4] / one.tangent_n_m[4], 1.5, 1e-3);
  }
}

TEST_F(ClosedTouches, AreOfFrictionlessRoundTipsOnTheSurface) {
  of(with_lump(0.008, 0.005, 4));
  Fingertip punch, stuck;
  punch.shape = FingertipShape::kFlatPunch;
  stuck.friction = Friction::kStuck;
  EXPECT_FALSE(contact->closed(punch));
  EXPECT_FALSE(contact->closed(stuck));
  SolidContact<float> below(*contact, 3);
  below.learn_shares(queue, solving);
  EXPECT_FALSE(below.closed(kTip));
  EXPECT_THROW(contact->closed(kTip)->answer(SolvePath::kShares, {0.03, 1, 0.03}), std::out_of_range);
}

}  // namespace
}  // namespace teletact::service
