// What is stated of the topmost millimetres (T3.6), and what comes of it.
#include "service/imaging/modulus/skin.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/imaging/modulus/pressed.h"

namespace teletact::service {
namespace {

using test::face, test::kModulusPa, test::Pressed;

constexpr double kRatio = 3;

Surface capsule(double thickness_m) {
  return {Surface::Kind::kCapsule, thickness_m, kRatio, 0.25 * thickness_m, 0.3 * kRatio};
}

TEST(Skin, ACapsuleCountsInEachLayerByItsPart) {
  const auto known = [](const Surface& surface) { return skin_known(surface, 1e-3); };
  const SkinPrior unknown = known({}), bare = known({Surface::Kind::kBare}), full = known(capsule(1e-3)),
                  half = known(capsule(1.5e-3));
  for (std::size_t k = 0; k < kSkinChanges; ++k) {
    EXPECT_EQ(bare.mean[k], 0);
    EXPECT_LT(bare.deviation[k], unknown.deviation[k] / 4);
  }
  EXPECT_NEAR(full.mean[1], std::log(kRatio), 1e-12);
  EXPECT_EQ(full.mean[2], 0);
  EXPECT_GT(full.deviation[1], bare.deviation[1]);
  EXPECT_GT(full.deviation[2], bare.deviation[2]) << "it may be thicker";
  EXPECT_EQ(full.deviation[3], bare.deviation[3]);
  // Between what layers beside each other and layers on each other bear.
  EXPECT_NEAR(half.mean[1], std::log(kRatio), 1e-12);
  EXPECT_NEAR(half.mean[2], (std::log(2.0) + std::log(1.5)) / 2, 1e-12);
  EXPECT_GE(half.deviation[2], (std::log(2.0) - std::log(1.5)) / 2);
  // It may be thinner, too, and softer: further down than up.
  Surface sure = capsule(3e-3);
  const double thinner = known(sure).deviation[3];
  sure.thickness_std_m = 1e-9;
  EXPECT_GT(thinner, 2 * known(sure).deviation[3]);
  EXPECT_GE(known(sure).deviation[3], -std::log(1 - 0.3));
  // Of an image so deep that its rows are higher.
  EXPECT_NEAR(skin_known(capsule(1e-3), 1.25e-3).mean[1], (std::log(2.6) - std::log(0.2 + 0.8 / 3)) / 2,
              1e-12);
}

// ln E of the topmost 3 mm over kModulusPa, in the mean: found, and its deviation.
struct Found {
  double log = 0, deviation = 0;
};
Found top_of(const ModulusEstimate& e, const Measured& m) {
  Found out;
  double nodes = 0;
  for (std::size_t n = 0; n < m.grid.size(); ++n)
    if (m.grid.y_m(n) < 3e-3 && std::isfinite(e.youngs_modulus[n]))
      out.log += std::log(e.youngs_modulus[n] / kModulusPa), out.deviation += e.log_deviation[n], ++nodes;
  return {out.log / nodes, out.deviation / nodes};
}

// What is stated is believed, the strain hardly tells it: it narrows what is true of it.
TEST(Skin, WhatIsStatedNarrowsWhatIsTrueOfIt) {
  const Pressed bare(face()), covered(
                                  face(), [](double, double) { return 1.0; },
                                  [](double, double y) { return y < 1e-3 ? std::log(kRatio) : 0; });
  const Surface known_well{Surface::Kind::kCapsule, 1e-3, kRatio, 1e-4, 0.1 * kRatio};
  const auto found = [](const Pressed& pressed, const Surface& surface) {
    const Found top = top_of(pressed.estimate({}, {}, test::kDepthM, surface), pressed.measured);
    std::printf("topmost 3 mm: ln E %.3f +- %.3f\n", top.log, top.deviation);
    return top;
  };
  const Found unknown = found(bare, {}), as_bare = found(bare, {Surface::Kind::kBare}),
              uneven = found(bare, {Surface::Kind::kUneven}), unknown_capsule = found(covered, {}),
              as_capsule = found(covered, known_well);
  EXPECT_LT(as_bare.deviation, 0.7 * unknown.deviation);
  EXPECT_LT(as_capsule.deviation, 0.8 * unknown_capsule.deviation);
  EXPECT_GT(uneven.deviation, std::log(2.0));
  for (const Found& f : {unknown, as_bare, uneven}) EXPECT_LE(std::abs(f.log), f.deviation);
  for (const Found& f : {unknown_capsule, as_capsule})
    EXPECT_LE(std::abs(f.log - std::log(kRatio) / 3), f.deviation);
}

}  // namespace
}  // namespace teletact::service
