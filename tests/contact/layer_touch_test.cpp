// The layer in closed form: against another program's digits, the theory of flat punches, a series that is
// known for thick layers, and its own derivative.
#include "service/contact/layer_touch.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

namespace teletact::service {
namespace {

constexpr double kModulusPa = 1e4, kRadiusM = 0.008;

double hertz_n(double nu, double indentation_m) {
  return 4.0 / 3 * kModulusPa / (1 - nu * nu) * std::sqrt(kRadiusM * indentation_m) * indentation_m;
}

// 10 kPa, nu 0.49, a paraboloid of 8 mm: Fredholm's equation with 32 and with 48 points, the same digits.
TEST(LayerTouch, HasTheKnownForces) {
  struct Known {
    double depth_m, indentation_m, force_n;
  };
  const LayerTouch layer(0.49);
  for (const Known& k : {Known{0.1, 0.001, 0.0512389},
                         {0.1, 0.002, 0.1469131},
                         {0.1, 0.004, 0.4237821},
                         {0.04, 0.001, 0.0538890},
                         {0.04, 0.002, 0.1581039},
                         {0.04, 0.004, 0.4721386},
                         {0.01, 0.001, 0.0725967},
                         {0.01, 0.002, 0.2490097},
                         {0.01, 0.004, 0.9399686}})
    EXPECT_NEAR(layer.touch(kModulusPa, k.depth_m, kRadiusM, k.indentation_m).force_n, k.force_n,
                2e-6 * k.force_n)
        << k.depth_m << ", " << k.indentation_m;
  for (const auto& [indentation, radius] :
       {std::pair{0.001, 2.9069e-3}, {0.002, 4.1606e-3}, {0.004, 5.9881e-3}})
    EXPECT_NEAR(layer.touch(kModulusPa, 0.04, kRadiusM, indentation).contact_radius_m, radius, 1e-7);
}

// What more of indentation adds is what a flat punch of the contact's size would.
TEST(LayerTouch, IsAsStiffAsAFlatPunchOfItsRadius) {
  const LayerTouch layer(0.49);
  for (const auto& [depth, punch] : {std::pair{0.04, 118.26591}, {0.01, 175.16500}}) {
    double low = 1e-4, high = 8e-3;
    while (high - low > 1e-12) {
      const double middle = (low + high) / 2;
      (layer.touch(kModulusPa, depth, kRadiusM, middle).contact_radius_m < 0.004 ? low : high) = middle;
    }
    EXPECT_NEAR(layer.touch(kModulusPa, depth, kRadiusM, low).stiffness_n_m, punch, 5e-6 * punch) << depth;
  }
}

// Dimitriadis et al., Determination of elastic moduli of thin layers of soft material using the atomic force
// microscope, Biophys. J. 82, 2002: bonded, to the fourth power of sqrt(R d) / depth. Some 0.2 % low at 0.1.
TEST(LayerTouch, IsTheSeriesOfThickLayersAtAnyPoissonRatio) {
  constexpr double kRatio = 0.1, kPi = std::numbers::pi;
  for (const double nu : {0.1, 0.3, 0.45, 0.4999}) {
    const double a = -(1.2876 - 1.4678 * nu + 1.3442 * nu * nu) / (1 - nu),
                 b = (0.6387 - 1.0277 * nu + 1.5164 * nu * nu) / (1 - nu);
    const double series =
        1 - 2 * a / kPi * kRatio + std::pow(2 * a / kPi * kRatio, 2) -
        8 / std::pow(kPi, 3) * (a * a * a + 4 * kPi * kPi / 15 * b) * std::pow(kRatio, 3) +
        16 * a / std::pow(kPi, 4) * (a * a * a + 3 * kPi * kPi / 5 * b) * std::pow(kRatio, 4);
    const double depth = std::sqrt(kRadiusM * 0.001) / kRatio;
    EXPECT_NEAR(LayerTouch(nu).touch(kModulusPa, depth, kRadiusM, 0.001).force_n / hertz_n(nu, 0.001), series,
                0.004 * series)
        << nu;
  }
}

TEST(LayerTouch, IsHertzOnAHalfSpaceAndScalesWithItsUnits) {
  for (const double nu : {0.0, 0.3, 0.49, 0.4999}) {
    const LayerTouch layer(nu);
    const LayerForce far = layer.touch(kModulusPa, 1e6, kRadiusM, 0.002);
    EXPECT_NEAR(far.force_n, hertz_n(nu, 0.002), 1e-8 * far.force_n) << nu;
    EXPECT_NEAR(far.stiffness_n_m, 1.5 * far.force_n / 0.002, 1e-7 * far.stiffness_n_m) << nu;
    EXPECT_NEAR(far.contact_radius_m, 0.004, 1e-10) << nu;
    const LayerForce one = layer.touch(kModulusPa, 0.01, kRadiusM, 0.002),
                     other = layer.touch(3 * kModulusPa, 0.02, 2 * kRadiusM, 0.004);
    EXPECT_NEAR(other.force_n, 12 * one.force_n, 1e-12 * other.force_n) << nu;
  }
}

TEST(LayerTouch, ItsStiffnessIsItsForcesDerivative) {
  for (const double nu : {0.0, 0.3, 0.49, 0.49999}) {
    const LayerTouch layer(nu);
    double before = 0;
    for (double ratio = 1e-3; ratio < LayerTouch::kMostRatio * 0.999; ratio *= 1.03) {
      const double d = ratio * ratio * 1e-4 / kRadiusM;  // on 10 mm
      const auto force = [&](double at) { return layer.touch(kModulusPa, 0.01, kRadiusM, at).force_n; };
      const double stiffness = layer.touch(kModulusPa, 0.01, kRadiusM, d).stiffness_n_m;
      EXPECT_NEAR((force(d * 1.0001) - force(d * 0.9999)) / (2e-4 * d), stiffness, 2e-5 * stiffness)
          << nu << ", " << ratio;
      EXPECT_GT(stiffness, before) << nu << ", " << ratio;
      before = stiffness;
    }
  }
}

TEST(LayerTouch, WhatItCannotAnswerItRefuses) {
  for (const double nu : {-0.1, 0.5, std::numeric_limits<double>::quiet_NaN()})
    EXPECT_THROW(LayerTouch{nu}, std::invalid_argument) << nu;
  const LayerTouch layer(0.49);
  EXPECT_EQ(layer.touch(kModulusPa, 0.04, kRadiusM, 0).force_n, 0);
  EXPECT_EQ(layer.touch(kModulusPa, 0.04, kRadiusM, -0.001).stiffness_n_m, 0);
  for (const double wrong : {0.0, -1.0, std::numeric_limits<double>::infinity()}) {
    EXPECT_THROW(layer.touch(wrong, 0.04, kRadiusM, 0.002), std::invalid_argument);
    EXPECT_THROW(layer.touch(kModulusPa, wrong, kRadiusM, 0.002), std::invalid_argument);
    EXPECT_THROW(layer.touch(kModulusPa, 0.04, wrong, 0.002), std::invalid_argument);
  }
  EXPECT_THROW(layer.touch(kModulusPa, 0.04, kRadiusM, std::numeric_limits<double>::quiet_NaN()),
               std::invalid_argument);
  EXPECT_NO_THROW(layer.touch(kModulusPa, 0.002, kRadiusM, 0.0031));
  EXPECT_THROW(layer.touch(kModulusPa, 0.002, kRadiusM, 0.0032), std::out_of_range);
}

}  // namespace
}  // namespace teletact::service
