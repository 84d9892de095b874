#include "service/scene/stitched_map.h"

#include <gtest/gtest.h>

#include <limits>

#include "service/scene/errors.h"
#include "tests/scene/windows.h"

namespace teletact::service {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

TEST(StitchedMap, WindowLandsWhereItWasMeasured) {
  StitchedMap map(tissue(0.1003, 0.0301));  // cells do not divide it evenly
  map.paste(window_of(inclusion(10e3, 5, 0.050, 0.012, 0.004), 0.0302, 0.0399, 0.0301));
  EXPECT_NEAR(map.mean_modulus_pa(0.048, 0.052, 0.010, 0.014), 50e3, 1);
  EXPECT_NEAR(map.mean_modulus_pa(0.032, 0.036, 0.010, 0.014), 10e3, 1);
  EXPECT_NEAR(map.measured_share(0.035, 0.065, 0, 0.025), 1, 0.05);
  EXPECT_EQ(map.measured_share(0.0, 0.029, 0, 0.025), 0);
}

TEST(StitchedMap, ColumnsNeverPublishedTakeTheNearestOne) {
  StitchedMap map(tissue(0.1, 0.03));
  map.paste(window_of([](double x_m, double) { return x_m < 0.05 ? 8e3 : 16e3; }, 0.03, 0.04, 0.03));
  EXPECT_NEAR(map.mean_modulus_pa(0.0, 0.03, 0.0, 0.03), 8e3, 1);
  EXPECT_NEAR(map.mean_modulus_pa(0.07, 0.1, 0.0, 0.03), 16e3, 1);
}

TEST(StitchedMap, ColumnsBetweenTwoWindowsTakeTheNearerOne) {
  StitchedMap map(tissue(0.1, 0.03));
  map.paste(window_of([](double, double) { return 8e3; }, 0, 0.04, 0.03));
  map.paste(window_of([](double, double) { return 16e3; }, 0.07, 0.03, 0.03));
  EXPECT_NEAR(map.mean_modulus_pa(0.042, 0.053, 0.0, 0.03), 8e3, 1);
  EXPECT_NEAR(map.mean_modulus_pa(0.057, 0.068, 0.0, 0.03), 16e3, 1);
}

TEST(StitchedMap, InvalidPixelsAreExtendedFromTheirNeighboursInLog) {
  StitchedMap map(tissue(0.04, 0.02));
  auto w = window_of([](double x_m, double) { return x_m < 0.02 ? 4e3 : 16e3; }, 0, 0.04, 0.02);
  for (std::size_t j = 0; j < w.grid.ny; ++j)
    for (std::size_t i = 0; i < w.grid.nx; ++i) {
      const double x_m = w.grid.origin_x_m + w.grid.dx_m * static_cast<double>(i);
      if (x_m > 0.015 && x_m < 0.025)
        w.valid[i + w.grid.nx * j] = 0, w.youngs_modulus_pa[i + w.grid.nx * j] = kNan;
    }
  map.paste(w);
  EXPECT_NEAR(map.mean_modulus_pa(0.016, 0.018, 0.005, 0.01), 4e3, 1);
  EXPECT_NEAR(map.mean_modulus_pa(0.022, 0.024, 0.005, 0.01), 16e3, 1);
  EXPECT_NEAR(map.measured_share(0.0165, 0.0235, 0, 0.02), 0, 1e-9);
  for (const float modulus_pa : map.youngs_modulus_pa()) {
    EXPECT_GE(modulus_pa, 4e3F * 0.999F);
    EXPECT_LE(modulus_pa, 16e3F * 1.001F);
  }
}

TEST(StitchedMap, OneWildPixelDoesNotMakeTheTissueRigid) {
  StitchedMap map(tissue(0.04, 0.02));
  auto w = window_of(homogeneous(10e3), 0, 0.04, 0.02);
  w.youngs_modulus_pa[w.grid.nx * 10 + 40] = 1e12F;
  w.youngs_modulus_pa[w.grid.nx * 20 + 40] = 1e-6F;
  map.paste(w);
  for (const float modulus_pa : map.youngs_modulus_pa()) EXPECT_NEAR(modulus_pa, 10e3, 1);
}

TEST(StitchedMap, NewestWindowCountsWhereTwoOverlap) {
  StitchedMap map(tissue(0.1, 0.02));
  map.paste(window_of(homogeneous(10e3), 0.0, 0.06, 0.02));
  map.paste(window_of(homogeneous(20e3), 0.05, 0.05, 0.02));
  EXPECT_NEAR(map.mean_modulus_pa(0.03, 0.05, 0.0, 0.02), 10e3, 1);
  EXPECT_NEAR(map.mean_modulus_pa(0.05, 0.06, 0.0, 0.02), 20e3, 1);
}

TEST(StitchedMap, MeanIsHarmonic) {
  StitchedMap map(tissue(0.04, 0.02));
  map.paste(window_of([](double x_m, double) { return x_m < 0.02 ? 5e3 : 20e3; }, 0, 0.04, 0.02));
  EXPECT_NEAR(map.mean_modulus_pa(0.016, 0.024, 0.004, 0.010), 8e3, 1);
}

// Cells of half a millimetre: one whole cell above the border, half of one below it.
TEST(StitchedMap, MeanWeighsACellByWhatOfItIsMeant) {
  StitchedMap map(tissue(0.04, 0.02));
  map.paste(window_of([](double, double y_m) { return y_m < 0.01 ? 8e3 : 16e3; }, 0, 0.04, 0.02));
  const double mean_pa = 1.5 / (1 / 8e3 + 0.5 / 16e3);
  EXPECT_NEAR(map.mean_modulus_pa(0.01, 0.03, 0.0095, 0.01025), mean_pa, 1e-3 * mean_pa);
  EXPECT_NEAR(map.mean_modulus_pa(0.01, 0.03, 0.00975, 0.0105), 1.5 / (0.5 / 8e3 + 1 / 16e3), 10);
}

TEST(StitchedMap, WindowWithTooLittleValidIsRefused) {
  StitchedMap map(tissue(0.04, 0.02));
  map.paste(window_of(homogeneous(10e3), 0, 0.04, 0.02));
  auto w = window_of(homogeneous(30e3), 0, 0.04, 0.02);
  for (std::size_t n = 0; n < w.valid.size(); ++n) w.valid[n] = n % 10 == 0;
  const auto before = map.youngs_modulus_pa();
  try {
    map.paste(w);
    FAIL() << "was accepted";
  } catch (const Error& error) {
    EXPECT_EQ(error.kind, ErrorKind::kPrecondition);
  }
  EXPECT_EQ(map.youngs_modulus_pa(), before);
  w.valid.assign(w.valid.size(), 1);
  w.youngs_modulus_pa.assign(w.valid.size(), kNan);
  EXPECT_THROW(map.paste(w), Error);
  EXPECT_EQ(map.youngs_modulus_pa(), before);
}

TEST(StitchedMap, SizesThatDoNotFitAreRefused) {
  StitchedMap map(tissue(0.04, 0.02));
  auto w = window_of(homogeneous(10e3), 0, 0.04, 0.02);
  w.valid.pop_back();
  EXPECT_THROW(map.paste(w), std::invalid_argument);
  EXPECT_THROW(map.mean_modulus_pa(0, 0.01, 0, 0.01), std::logic_error);  // nothing is published
}

}  // namespace
}  // namespace teletact::service
