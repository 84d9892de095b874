// Hop-free start for the displacement: of all correlation peaks of a node, the one that its neighbours can
// reach within the largest strain (dynamic programming along the rows and columns of the coarse grid).
#pragma once

#include <vector>

namespace teletact::service {

struct LagVolume {
  int nx = 0, ny = 0, lag_count = 0;
  std::vector<float> correlation;  // [node][lag], node i + nx j
};

// Lag of every node, in lags from the first, with a parabolic fraction. Minimises, summed over the four
// directions,
//   L(p, d) = 1 - correlation(p, d) + min over |e| <= reach of L(previous, d + e) + slope_cost |e|
// (Hirschmueller's semi-global aggregation). reach_down: per coarse step along the columns, reach_across
// along the rows.
std::vector<float> find_paths(const LagVolume&, int reach_down, int reach_across, float slope_cost);

}  // namespace teletact::service
