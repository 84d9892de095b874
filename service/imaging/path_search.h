// Hop-free start for the displacement: of all correlation peaks of a node, the one that its neighbours can
// reach within the largest strain (dynamic programming along the rows and columns of the coarse grid).
#pragma once

#include <vector>

namespace teletact::service {

struct LagVolume {
  int nx = 0, ny = 0, lateral_count = 0, lag_count = 0;
  std::vector<float> correlation;  // [node][lateral][lag], node i + nx j
};

// Axial lag of every node, in lags from the first, with a parabolic fraction. Minimises, summed over the four
// directions,
//   L(p, d) = 1 - max over lateral of correlation(p, d) + min over |e| <= reach of L(previous, d + e) +
//   slope_cost |e|
// (Hirschmueller's semi-global aggregation). reach: axial reach per coarse step in rows, lateral_reach in
// columns.
std::vector<float> find_paths(const LagVolume&, int axial_reach, int lateral_reach, float slope_cost);

// Lateral lag of every node, in lags from the first, at its axial lag `axial`: find_paths() over these.
std::vector<float> find_lateral_paths(const LagVolume&, const std::vector<float>& axial, float slope_cost);

}  // namespace teletact::service
