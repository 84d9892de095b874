#include "service/imaging/tracking/search.h"

#include <gtest/gtest.h>

#include <cmath>

namespace teletact::service {
namespace {

// True peaks on a slope of 2 lags per row; one node in three shows a higher false peak six lags away.
LagVolume hopping(int nx, int ny) {
  LagVolume v{nx, ny, 64, {}};
  v.correlation.assign(static_cast<std::size_t>(nx * ny * 64), 0.0f);
  for (int node = 0; node < nx * ny; ++node) {
    const int truth = 10 + 2 * (node / nx);
    float* const c = v.correlation.data() + 64 * node;
    c[truth] = 0.8f;
    c[truth - 1] = 0.5f;
    c[truth + 1] = 0.5f;
    if (node % 3 == 0) c[truth + 6] = 0.95f;
  }
  return v;
}

TEST(PathSearch, FollowsTheReachablePeakNotTheHighest) {
  const int nx = 5, ny = 19;
  const std::vector<float> path = find_paths(hopping(nx, ny), 3, 3, 0.02f);
  ASSERT_EQ(path.size(), static_cast<std::size_t>(nx * ny));
  for (int node = 0; node < nx * ny; ++node) EXPECT_NEAR(path[node], 10 + 2 * (node / nx), 0.5) << node;
}

TEST(PathSearch, CrossesSilenceOnTheSlopeOfItsNeighbours) {
  LagVolume v = hopping(4, 15);
  for (std::size_t n = 4 * 7 * 64; n < 4 * 8 * 64; ++n) v.correlation[n] = 0;
  const std::vector<float> path = find_paths(v, 3, 3, 0.02f);
  for (int i = 0; i < 4; ++i) EXPECT_NEAR(path[4 * 7 + i], 24, 2.01);
}

// Three lags, as laterally: true peaks in the last; every eighth node shows a higher false one.
TEST(PathSearch, LeavesOutASinglePeakOfItsOwn) {
  LagVolume v{8, 5, 3, {}};
  v.correlation.assign(8 * 5 * 3, 0.0f);
  for (std::size_t node = 0; node < 40; ++node) {
    v.correlation[3 * node + 2] = 0.7f;
    if (node % 8 == 3) v.correlation[3 * node] = 0.8f;
  }
  const std::vector<float> lateral = find_paths(v, 1, 1, 0.25f);
  for (const float m : lateral) EXPECT_NEAR(m, 2, 0.5);
}

// One column with its peak at lag 30 in every row.
LagVolume column(int rows) {
  LagVolume v{1, rows, 64, {}};
  v.correlation.assign(static_cast<std::size_t>(rows) * 64, 0.0f);
  for (int j = 0; j < rows; ++j) v.correlation[static_cast<std::size_t>(64 * j + 30)] = 0.5f;
  return v;
}

// Two lags aside the correlation is higher by .01, less than twice what going there and back costs.
TEST(PathSearch, ASlopeHasItsCost) {
  LagVolume v = column(9);
  v.correlation[64 * 4 + 32] = 0.51f;
  for (const float lag : find_paths(v, 3, 3, 0.02f)) EXPECT_NEAR(lag, 30, 0.5);
  EXPECT_NEAR(find_paths(v, 3, 3, 0.001f).at(4), 32, 0.5);
}

TEST(PathSearch, SilenceAtEitherEndFollowsWhatIsHeardBesideIt) {
  LagVolume v = column(12);
  for (const std::size_t row : {0, 1, 2, 9, 10, 11}) v.correlation[64 * row + 30] = 0;
  for (const float lag : find_paths(v, 3, 3, 0.02f)) EXPECT_NEAR(lag, 30, 0.5);
}

TEST(PathSearch, OneNodeIsItsOwnPath) {
  LagVolume v{1, 1, 8, {0, 0.1f, 0.2f, 0.6f, 0.2f, 0, 0, 0}};
  EXPECT_NEAR(find_paths(v, 2, 2, 0.02f).at(0), 3, 1e-6);
}

}  // namespace
}  // namespace teletact::service
