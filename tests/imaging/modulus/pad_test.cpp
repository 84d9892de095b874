// A stand-off pad of known modulus on the probe (T3.6).
#include "service/imaging/modulus/pad.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>

#include "service/imaging/modulus/judge.h"
#include "tests/imaging/modulus/pressed.h"

namespace teletact::service {
namespace {

using test::face, test::kModulusPa, test::Pressed;

constexpr double kPadM = 7e-3;

StandoffPad pad(double modulus_pa, double thickness_m = kPadM) {
  return {thickness_m, modulus_pa, 0.05 * thickness_m, 0.05 * modulus_pa};
}

// Of tissue under a pad of `ratio`, with or without the force.
ModulusEstimate estimate(const Pressed& pressed, const StandoffPad& stated, bool force,
                         const ModulusBudget& budget = {}) {
  TissueExtent tissue{0.1, test::kDepthM, 0.035, 0.49, Plane::kSolid, test::kElevationM};
  tissue.probe_elevation_std_m = 0.03 * test::kElevationM, tissue.pad = stated;
  const ModulusInput in{
      pressed.measured, test::kWidthM, tissue, force ? pressed.force : std::nullopt, {}, budget};
  ModulusEstimate out = make_solid(imaging_device()->queue(), {})->estimate(in);
  StripCache strips;
  judge(in, strips, out);
  return out;
}

Pressed under(double ratio, double pad_m = kPadM) {
  return Pressed(
      face(), [](double, double) { return 1.0; },
      [=](double, double y) { return y < pad_m ? std::log(ratio) : 0; });
}

TEST(Pad, TellsTheModulusOfWhatIsBelow) {
  for (const double ratio : {0.4, 1.0, 2.0}) {
    const Pressed pressed = under(ratio);
    const ModulusEstimate e = estimate(pressed, pad(ratio * kModulusPa), false);
    const double found = test::background(e, pressed.measured);
    std::printf("pad of %.1f: %.0f Pa, deviation %.3f; %s\n", ratio, found, e.median_deviation,
                e.model.c_str());
    EXPECT_TRUE(e.absolute);
    EXPECT_NEAR(found, kModulusPa, 0.08 * kModulusPa) << ratio;
    EXPECT_LE(std::abs(std::log(found / kModulusPa)), 1.96 * e.median_deviation) << ratio;
    EXPECT_FALSE(test::warned(e, ModulusFlag::kElevation)) << ratio;
    for (std::size_t n = 0; n < pressed.measured.grid.size(); ++n)
      if (const double y_m = pressed.measured.grid.y_m(n); std::abs(y_m - kPadM) > 0.5e-3) {
        EXPECT_EQ(std::isfinite(e.youngs_modulus[n]), y_m > kPadM) << y_m;
      }
  }
}

// Twice as stiff a pad is twice as stiff tissue, and its deviation is the tissue's.
TEST(Pad, GivesTheScaleAndItsDeviation) {
  const Pressed pressed = under(0.5);
  StandoffPad known = pad(0.5 * kModulusPa);
  const ModulusEstimate one = estimate(pressed, known, false);
  known.youngs_modulus_pa *= 2, known.youngs_modulus_std_pa *= 8;
  const ModulusEstimate two = estimate(pressed, known, false);
  for (std::size_t n = 0; n < one.youngs_modulus.size(); ++n) {
    if (std::abs(pressed.measured.grid.y_m(n) - 12.5e-3) > 2.5e-3)
      continue;  // at the ends no strain tells it
    EXPECT_NEAR(two.youngs_modulus[n], 2 * one.youngs_modulus[n], 1e-5 * two.youngs_modulus[n]);
    EXPECT_NEAR(std::pow(two.log_deviation[n], 2) - std::pow(one.log_deviation[n], 2),
                0.2 * 0.2 - 0.05 * 0.05, 2e-3);
  }
}

TEST(Pad, IsContradictedByItsStrainAndByTheForce) {
  const Pressed pressed = under(0.5);
  // Thinner than is stated by five deviations; by the force, which gives the scale, three times as soft.
  const ModulusEstimate thin = estimate(pressed, pad(0.5 * kModulusPa, 1.25 * kPadM), true);
  EXPECT_TRUE(test::warned(thin, ModulusFlag::kElevation)) << thin.model;
  EXPECT_FALSE(test::warned(thin, ModulusFlag::kScale));
  const ModulusEstimate soft = estimate(pressed, pad(1.5 * kModulusPa), true);
  EXPECT_TRUE(test::warned(soft, ModulusFlag::kScale)) << soft.model;
  EXPECT_NEAR(test::background(soft, pressed.measured), kModulusPa, 0.1 * kModulusPa);
}

// Without time for other tissue what is stated of it is as open as it is stated.
TEST(Pad, OfAnUnknownThicknessIsUncertainWithoutTimeToo) {
  const Pressed pressed = under(2);
  StandoffPad known = pad(2 * kModulusPa);
  const double well = estimate(pressed, known, false, {.solves = 10}).median_deviation;
  known.thickness_std_m = 0.3 * kPadM;
  EXPECT_GT(estimate(pressed, known, false, {.solves = 10}).median_deviation, well + 0.01);
}

// Whose echo is silent tells nothing, as a pad that is thinner than is stated; nor what is not strained below
// it.
TEST(Pad, WithoutStrainIsRefused) {
  using Silent = bool (*)(double y_m);
  for (const auto& [silent, said] :
       {std::pair<Silent, const char*>([](double y_m) { return y_m < kPadM; }, "tracked in a pad"),
        {[](double y_m) { return y_m < kPadM && y_m > 3e-3; }, "tracked in a pad"},
        {[](double y_m) { return y_m > kPadM; }, "tracked below a pad"}}) {
    Pressed pressed = under(0.5);
    for (std::size_t n = 0; n < pressed.measured.grid.size(); ++n)
      if (silent(pressed.measured.grid.y_m(n))) pressed.measured.strain_valid[n] = 0;
    try {
      estimate(pressed, pad(0.5 * kModulusPa), false);
      ADD_FAILURE() << said;
    } catch (const std::invalid_argument& error) {
      EXPECT_NE(std::string(error.what()).find(said), std::string::npos) << error.what();
    }
  }
}

// Thicker or thinner than is stated: the strain leads there as far as the image goes, or it is refused by
// name.
TEST(Pad, ThatIsStatedWronglyStaysWithinTheImage) {
  const auto wrong = [](double true_m, double stated_m) {
    StandoffPad stated = pad(0.3 * kModulusPa, stated_m);
    stated.thickness_std_m = 0.9 * stated_m;
    return estimate(under(0.3, true_m), stated, false);
  };
  const ModulusEstimate thicker = wrong(0.016, 0.0145);
  EXPECT_TRUE(std::isfinite(thicker.median_deviation) && std::isfinite(thicker.model_deviation));
  EXPECT_GT(thicker.background, 0);
  try {
    wrong(0.005, 0.0067);
    ADD_FAILURE() << "nothing of it is left to be told by";
  } catch (const std::invalid_argument& error) {
    EXPECT_EQ(std::string(error.what()).find("pad_thickness_m: no strain was tracked in"), 0U)
        << error.what();
  }
}

}  // namespace
}  // namespace teletact::service
