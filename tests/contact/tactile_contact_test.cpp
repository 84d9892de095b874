// What a tactile display shows of solid tissue: the image of a contact, and what of it a lump is the cause
// of.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "service/contact/solid_contact.h"
#include "service/contact/tactile_image.h"
#include "tests/solver/block_stencil.h"
#include "tests/tissue/solid/solids.h"

namespace teletact::service {
namespace {

constexpr double kMiddle = 0.032;
constexpr Fingertip kRound{};
constexpr Fingertip kPad{// a disc of 16 mm, 2 mm of 20 kPa
                         .shape = FingertipShape::kPad,
                         .radius_m = 0.001,
                         .half_width_m = 0.008,
                         .pad_m_pa = 0.002 / 2e4};

SolidTissue block(double spacing_m, double lump_pa) {
  const auto n = static_cast<std::size_t>(std::lround(2 * kMiddle / spacing_m));
  return solid({n, n, spacing_m, spacing_m, graded_rows(0.040, 32, 1.04)}, 0.49,
               [lump_pa](double x, double y, double z) {
                 return std::hypot(x - kMiddle, y - 0.010, z - kMiddle) < 0.005 ? lump_pa : 1e4;
               });
}

double force_of(const std::vector<NodalPressure>& nodes) {
  return share_among_taxels(nodes, {}, {0, 0}).force_n;
}

// Of an observer who knows both images: white noise on each taxel, 1/31.6 of the largest of the image.
double detectability(SolidContact<float>& contact, const Fingertip& tip, const Vector3& pose) {
  const TaxelGrid grid;
  const auto pressure = contact.touch(tip, pose).pressure;
  const auto homogeneous = contact.layered_pressure(tip, pose, force_of(pressure));
  const Taxels with = share_among_taxels(pressure, grid, {pose[0], pose[2]});
  const Taxels without = share_among_taxels(homogeneous, grid, {pose[0], pose[2]});
  EXPECT_NEAR(without.force_n, with.force_n, 2e-6 * with.force_n) << "at equal force";
  double squares = 0, largest = 0;
  for (std::size_t t = 0; t < with.pressure_pa.size(); ++t) {
    squares += std::pow(with.pressure_pa[t] - without.pressure_pa[t], 2);
    largest = std::max(largest, with.pressure_pa[t]);
  }
  return 31.6 * std::sqrt(squares) / largest;
}

// A ball of 10 mm and contrast 5, its centre 10 mm deep under the middle, pressed by 2 mm.
TEST(TactileContact, ALumpIsSeenUnderATipAndBetterUnderAPad) {
  SolidContact<float> contact(test_device()->queue(), block(0.001, 5e4));
  for (const double beside_m : {0.0, 0.0005}) {
    const Vector3 pose{kMiddle + beside_m, 0.002, kMiddle};
    const double round = detectability(contact, kRound, pose), pad = detectability(contact, kPad, pose);
    std::printf("%.1f mm beside the middle: d' %.1f under the rounded tip, %.1f under the pad\n",
                1e3 * beside_m, round, pad);
    EXPECT_GE(round, 3);
    EXPECT_GE(pad, 10);
  }
  const Vector3 beside{kMiddle + 0.022, 0.002, kMiddle};
  EXPECT_LT(detectability(contact, kRound, beside), 0.3) << "far from it there is little to see";
}

TEST(TactileContact, PressureWithoutALumpIsTheContacts) {
  SolidContact<float> contact(test_device()->queue(), block(0.002, 1e4));
  for (Fingertip tip : {kRound, kPad})
    for (const Friction friction : {Friction::kFrictionless, Friction::kStuck}) {
      tip.friction = friction;
      const Vector3 pose{kMiddle + 0.0007, 0.0015, kMiddle - 0.0004};
      const auto pressure = contact.touch(tip, pose).pressure;
      // From another depth: the force alone says which.
      const auto found = contact.layered_pressure(tip, {pose[0], 0.004, pose[2]}, force_of(pressure));
      ASSERT_EQ(found.size(), pressure.size());
      for (std::size_t n = 0; n < found.size(); ++n) {
        EXPECT_NEAR(found[n].pressure_pa, pressure[n].pressure_pa, 1e-3 * pressure[0].pressure_pa);
        EXPECT_EQ(found[n].position_m, pressure[n].position_m);
      }
    }
  EXPECT_EQ(contact.corrections(), 0u) << "it learns nothing";
}

TEST(TactileContact, AForceThatNoDepthBearsIsRefused) {
  SolidContact<float> contact(test_device()->queue(), block(0.002, 1e4));
  EXPECT_ANY_THROW(contact.layered_pressure(kRound, {kMiddle, 0.002, kMiddle}, 1e3));
  EXPECT_ANY_THROW(contact.layered_pressure(kRound, {kMiddle, 0.002, kMiddle}, NAN));
}

// What the warning of a mesh too coarse is made from: where a pad spans kMinPadSpacings the force depends
// on where it stands between the nodes by less than 5 %.
TEST(TactileContact, APadsForceRipplesLittleOverItsMesh) {
  for (const double spacing : {0.001, 0.002}) {
    SolidContact<float> contact(test_device()->queue(), block(spacing, 1e4));
    for (const double half_width : {0.004, 0.008})
      for (const double depth : {0.0005, 0.002}) {
        Fingertip tip = kPad;
        tip.half_width_m = half_width;
        if (half_width + std::sqrt(2 * tip.radius_m * depth) < choices::kMinPadSpacings * spacing) continue;
        double low = HUGE_VAL, high = 0;
        for (const double x : {0.0, 0.25, 0.5})
          for (const double z : {0.0, 0.25, 0.5}) {
            const double f =
                -contact.touch(tip, {kMiddle + x * spacing, depth, kMiddle + z * spacing}).force_n[1];
            low = std::min(low, f);
            high = std::max(high, f);
          }
        EXPECT_LT(high - low, 0.05 * low) << half_width << " m on " << spacing << " at " << depth;
      }
  }
}

}  // namespace
}  // namespace teletact::service
