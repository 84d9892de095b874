#include "client/report/inclusions.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace teletact::client {
namespace {

// 10 kPa with 10 % of noise and discs of what a reference-stress map keeps of their contrast.
ModulusGrid noisy_map(const std::vector<Inclusion>& discs, unsigned seed = 1) {
  ModulusGrid map{203, 61, 0.0003, 0.0002, 0.0005, 0.00055, {}};
  std::mt19937 random(seed);
  std::normal_distribution<double> noise(1.0, 0.1);
  for (std::size_t j = 0; j < map.ny; ++j)
    for (std::size_t i = 0; i < map.nx; ++i) {
      double pa = 10e3;
      for (const Inclusion& disc : discs)
        if (std::hypot(map.x(i) - disc.x_m, map.y(j) - disc.y_m) < disc.diameter_m / 2) pa *= disc.contrast;
      map.pa.push_back(static_cast<float>(pa * noise(random)));
    }
  return map;
}

TEST(Inclusions, AreFoundWhereTheyAreWithTheirSizeAndContrast) {
  const std::vector<Inclusion> discs{{0.030, 0.012, 0.008, 2.0}, {0.075, 0.018, 0.012, 5.0}};
  const InclusionReport report = find_inclusions(noisy_map(discs), discs);
  ASSERT_EQ(report.found.size(), 2u);
  EXPECT_TRUE(report.spurious.empty());
  EXPECT_NEAR(report.background_pa, 10e3, 300);
  for (std::size_t t = 0; t < discs.size(); ++t) {
    ASSERT_GE(report.match[t], 0);
    const FoundInclusion& found = report.found[static_cast<std::size_t>(report.match[t])];
    EXPECT_NEAR(found.x_m, discs[t].x_m, 0.0005);
    EXPECT_NEAR(found.y_m, discs[t].y_m, 0.0005);
    EXPECT_NEAR(found.diameter_m, discs[t].diameter_m, 0.001);
    EXPECT_NEAR(found.contrast, discs[t].contrast, 0.05 * discs[t].contrast);
  }
}

TEST(Inclusions, NoiseAloneInventsNone) {
  for (unsigned seed = 1; seed <= 5; ++seed)
    EXPECT_TRUE(find_inclusions(noisy_map({}, seed), {}).found.empty());
}

TEST(Inclusions, AbsentIsMissedAndUntrueIsInvented) {
  const std::vector<Inclusion> shown{{0.030, 0.012, 0.008, 3.0}}, truth{{0.0361, 0.012, 0.008, 3.0}};
  const InclusionReport report = find_inclusions(noisy_map(shown), truth);
  EXPECT_EQ(report.match[0], -1) << "6.1 mm away is not the same";
  EXPECT_EQ(report.spurious.size(), 1u);
}

TEST(Inclusions, EachMatchesOnceAndTheNearestWins) {
  const std::vector<Inclusion> shown{{0.030, 0.012, 0.008, 3.0}};
  const std::vector<Inclusion> truth{{0.033, 0.012, 0.008, 3.0}, {0.029, 0.012, 0.008, 3.0}};
  const InclusionReport report = find_inclusions(noisy_map(shown), truth);
  EXPECT_EQ(report.match[0], -1);
  EXPECT_EQ(report.match[1], 0);
}

TEST(Inclusions, UnknownPartsAreNeitherStiffNorSoft) {
  const std::vector<Inclusion> discs{{0.030, 0.012, 0.010, 3.0}};
  ModulusGrid map = noisy_map(discs);
  for (std::size_t j = 0; j < map.ny; ++j)
    for (std::size_t i = 0; i < map.nx; ++i)
      if (i == 60 || j > 45) map.pa[i + map.nx * j] = std::numeric_limits<float>::quiet_NaN();
  const InclusionReport report = find_inclusions(map, discs);
  EXPECT_EQ(report.found.size(), 1u) << "a line without values through the disc must not cut it in two";
  EXPECT_GE(report.match[0], 0);
}

TEST(Inclusions, AMapWithoutValuesIsRefused) {
  ModulusGrid map{3, 3, 0, 0, 1e-3, 1e-3, std::vector<float>(9, std::numeric_limits<float>::quiet_NaN())};
  EXPECT_THROW(find_inclusions(map, {}), std::invalid_argument);
  map.pa.resize(5);
  EXPECT_THROW(find_inclusions(map, {}), std::invalid_argument);
}

}  // namespace
}  // namespace teletact::client
