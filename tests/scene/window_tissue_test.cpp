#include "service/scene/tissue_models.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

double smallest_step(const std::vector<double>& at, double begin, double end, bool largest) {
  double found = largest ? 0 : HUGE_VAL;
  for (std::size_t k = 0; k + 1 < at.size(); ++k)
    if (at[k] >= begin - 1e-9 && at[k + 1] <= end + 1e-9)
      found = largest ? std::max(found, at[k + 1] - at[k]) : std::min(found, at[k + 1] - at[k]);
  return found;
}

TEST(WindowTissue, IsFineUnderTheFingerAndCoarseFarAway) {
  const SceneGeometry g = tissue(0.300, 0.040);
  const auto x = window_columns_m(g, 0.120, 0.180);
  EXPECT_NEAR(x.front(), 0.020, 1e-9);
  EXPECT_NEAR(x.back(), 0.280, 1e-9);
  EXPECT_LE(smallest_step(x, 0.104, 0.196, true), 0.001 + 1e-9);
  EXPECT_LE(smallest_step(x, 0, 0.3, true), 0.008 + 1e-9);
  EXPECT_GE(smallest_step(x, 0, 0.104, true), 0.004);
  EXPECT_GE(smallest_step(x, 0, 0.3, false), 0.0005);
  EXPECT_LE(x.size(), 140U);
  const auto at_border = window_columns_m(g, 0, 0.060);
  EXPECT_EQ(at_border.front(), 0);
  EXPECT_NEAR(at_border.back(), 0.160, 1e-9);
}

TEST(WindowTissue, NeighboursHaveTheSameNodesUnderTheFinger) {
  const SceneGeometry g = tissue(0.300, 0.040);
  const auto a = window_columns_m(g, 0.0597, 0.1199), b = window_columns_m(g, 0.1199, 0.1801);
  const auto near = [](const std::vector<double>& at, double x) {
    double nearest = HUGE_VAL;
    for (const double k : at) nearest = std::min(nearest, std::abs(k - x));
    return nearest;
  };
  for (const double x : a)
    if (x > 0.1199 - 0.016 && x < 0.1199 + 0.016) {
      EXPECT_LE(near(b, x), 1e-9) << x;
    }
}

TEST(WindowTissue, RowsCoverTheDepth) {
  for (const double depth_m : {0.0031, 0.020, 0.0247, 0.040, 0.0633, 0.2}) {
    const auto y = window_rows_m(tissue(0.1, depth_m));
    EXPECT_EQ(y.front(), 0);
    EXPECT_NEAR(y.back(), depth_m, 1e-12);
    EXPECT_LE(smallest_step(y, 0, 0.022, true), 0.001 + 1e-9) << depth_m;
    EXPECT_LE(smallest_step(y, 0, depth_m, true), 0.002 + 1e-9) << depth_m;
  }
}

// Where the grid ends inside of the tissue nothing holds it.
TEST(WindowTissue, TakesTheScenesThicknessAndSupports) {
  SceneGeometry g = tissue(0.400, 0.040);
  g.thickness_m = 0.021;
  g.supports.left = g.supports.right = EdgeSupport::kFixed;
  StitchedMap map(g);
  map.paste(window_of(homogeneous(10e3), 0, 0.400, 0.040));
  const auto supports = [&](double begin_m, double end_m) {
    const auto model = build_window_tissue(g, map, begin_m, end_m);
    EXPECT_EQ(model->problem().thickness_m, 0.021);
    EXPECT_EQ(model->problem().supports.bottom, EdgeSupport::kFixed);
    return std::pair(model->problem().supports.left, model->problem().supports.right);
  };
  EXPECT_EQ(supports(0, 0.060), std::pair(EdgeSupport::kFixed, EdgeSupport::kFree));
  EXPECT_EQ(supports(0.170, 0.230), std::pair(EdgeSupport::kFree, EdgeSupport::kFree));
  EXPECT_EQ(supports(0.340, 0.400), std::pair(EdgeSupport::kFree, EdgeSupport::kFixed));
}

TEST(WindowTissue, ElementsTakeTheMapsModulus) {
  const SceneGeometry g = tissue(0.120, 0.030);
  StitchedMap map(g);
  map.paste(window_of(inclusion(10e3, 6, 0.060, 0.012, 0.005), 0.030, 0.060, 0.030));
  const auto model = build_window_tissue(g, map, 0.030, 0.090);
  const TissueGrid& grid = model->problem().grid;
  for (std::size_t j = 0; j + 1 < grid.ny(); ++j)
    for (std::size_t i = 0; i + 1 < grid.nx(); ++i) {
      const double x = 0.5 * (grid.x_m[i] + grid.x_m[i + 1]), y = 0.5 * (grid.y_m[j] + grid.y_m[j + 1]);
      const double r = std::hypot(x - 0.060, y - 0.012),
                   e = model->problem().material.youngs_modulus_pa[grid.element(i, j)];
      if (r < 0.004 || r > 0.012) {
        EXPECT_NEAR(e, r < 0.004 ? 60e3 : 10e3, 1) << x << " " << y;
      }
      EXPECT_GE(e, 9.99e3);
      EXPECT_LE(e, 60.1e3);
    }
}

}  // namespace
}  // namespace teletact::service
