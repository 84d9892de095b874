// The exact kernel of stacked layers against its closed form for one, and against elements for several.
#include "service/tissue/solid/layered_kernel.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "service/tissue/solid/layered_factor.h"
#include "tests/tissue/solid/solids.h"

namespace teletact::service {
namespace {

// Johnson, Contact Mechanics, 5.8: one layer bonded to rigid ground.
double one_layer(double q, double nu) {
  const double k = 3 - 4 * nu;
  return (2 * k * std::sinh(2 * q) - 4 * q) / (2 * k * std::cosh(2 * q) + 4 * q * q + 1 + k * k);
}

TEST(LayeredKernel, OfOneLayerIsTheClosedFormHoweverItIsCut) {
  for (const double nu : {0.0, 0.3, 0.49, 0.4999})
    for (const double q : {0.02, 0.3, 1.0, 4.0, 30.0}) {
      constexpr double kDepth = 0.04;
      const double truth = one_layer(q, nu), s = q / kDepth;
      EXPECT_NEAR(layered_kernel({{kDepth}, {1e4}, nu}, s), truth, 1e-8 * truth) << nu << ' ' << q;
      const std::vector<double> cut{0.001, 0.007, 0.002, 0.03};
      EXPECT_NEAR(layered_kernel({cut, {1e4, 1e4, 1e4, 1e4}, nu}, s), truth, 1e-5 * truth) << nu << ' ' << q;
    }
}

// Elements ever finer go to it as the square of their size.
TEST(LayeredKernel, OfSeveralLayersIsWhatFineElementsGoTo) {
  constexpr double kNu = 0.45, kPeriod = 0.016;
  const LayerStack stack{{0.004, 0.006, 0.010}, {3e4, 1e4, 5e4}, kNu};
  const auto of_elements = [&](std::size_t columns) {
    const double spacing = kPeriod / double(columns);
    SolidGrid grid{columns, 1, spacing, spacing, {}};
    for (std::size_t j = 0; double(j) * spacing < 0.0201; ++j) grid.y_m.push_back(double(j) * spacing);
    const auto layers = layered(solid(grid, kNu, [](double, double y, double) {
      return y < 0.004 ? 3e4 : y < 0.010 ? 1e4 : 5e4;
    }));
    const std::size_t pitch = columns / 2 + 8;
    // yy of one wave along x; a nodal force is a pressure times its share of the surface
    return row_symbol(grid, layers, kNu, pitch)[3 * pitch + 1] * spacing * spacing;
  };
  const double s = 2 * std::numbers::pi / kPeriod;
  const double exact = layered_kernel(stack, s) * 2 * (1 - kNu * kNu) / (3e4 * s);
  const double coarse = of_elements(16) / exact - 1, fine = of_elements(32) / exact - 1;
  EXPECT_GT(std::abs(coarse), 3 * std::abs(fine));
  EXPECT_LT(std::abs((4 * fine - coarse) / 3), 3e-4);
  EXPECT_GT(std::abs(fine), 1e-3);  // else it shows nothing
}

}  // namespace
}  // namespace teletact::service
