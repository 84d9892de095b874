#include "service/imaging/modulus/stated_depth.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>

namespace teletact::service {
namespace {

constexpr double kKernelM = 2.5e-3, kStrain = -0.01, kDepthM = 0.020, kImageM = 0.040;

struct Below {
  std::function<double(double y_m)> strain;
  double noise = 1e-4, valid_to_m = 1;
};

// Of an image 20 by 40 mm, strained as tissue to the stated 20 mm, from there on as told.
Measured measured(const Below& below) {
  Measured m;
  m.grid = {40, 133, 0, 0, 0.0005, 0.0003};
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  for (std::size_t n = 0; n < m.grid.size(); ++n) {
    const double y_m = m.grid.y_m(n);
    m.axial_strain.push_back(
        static_cast<float>((y_m < kDepthM ? kStrain : below.strain(y_m)) + below.noise * normal(random)));
    m.axial_strain_noise.push_back(static_cast<float>(below.noise));
    m.strain_valid.push_back(y_m < below.valid_to_m);
    if (y_m >= below.valid_to_m) m.axial_strain.back() = NAN;
  }
  return m;
}

double found_m(const Below& below, double depth_std_m = 0) {
  TissueExtent tissue{.width_m = 0.1, .depth_m = kDepthM, .plane = Plane::kSolid};
  tissue.depth_std_m = depth_std_m;
  return strained_below(tissue, measured(below), kKernelM);
}

std::function<double(double)> down_to(double end_m) {
  return [end_m](double y_m) { return y_m < end_m ? kStrain / 2 : 0; };
}

TEST(StatedDepth, IsDoubtedAsFarAsThereIsStrain) {
  EXPECT_NEAR(found_m({down_to(1)}), kImageM, 1e-3);
  EXPECT_NEAR(found_m({down_to(0.034)}), 0.034, 2e-3) << "not by the rest of a deep image";
  EXPECT_NEAR(found_m({.strain = down_to(1), .valid_to_m = 0.032}), 0.032, 2e-3) << "nor untracked";
}

TEST(StatedDepth, IsBelievedWhereNothingBelowSaysOtherwise) {
  EXPECT_EQ(found_m({down_to(0)}), 0) << "a support rests";
  EXPECT_EQ(found_m({down_to(kDepthM + kKernelM / 2)}), 0) << "as the kernel sees it";
  EXPECT_EQ(found_m({.strain = down_to(0), .noise = 0.02}), 0);
  EXPECT_EQ(found_m({[](double) { return -kStrain; }}), 0) << "what is stretched rests on nothing";
  EXPECT_EQ(found_m({.strain = down_to(1), .valid_to_m = 0.024}), 0);
  EXPECT_EQ(found_m({down_to(0.027)}, 0.004), 0) << "within what is stated of it";
}

TEST(StatedDepth, IsOfSolidsAndOnlyWhereItIsStated) {
  const Measured m = measured({down_to(1)});
  TissueExtent tissue{.width_m = 0.1, .depth_m = kDepthM, .plane = Plane::kSolid};
  const TissueExtent deeper = believed(tissue, m, kKernelM);
  EXPECT_EQ(deeper.doubted_depth_m, kDepthM);
  EXPECT_FALSE(deeper.depth_stated);
  EXPECT_NEAR(deeper.depth_m, kImageM, 1e-3);
  tissue.depth_stated = false;
  EXPECT_EQ(believed(tissue, m, kKernelM).depth_m, kDepthM);
  tissue.depth_stated = true, tissue.plane = Plane::kStrain;
  EXPECT_EQ(believed(tissue, m, kKernelM).depth_m, kDepthM);
}

}  // namespace
}  // namespace teletact::service
