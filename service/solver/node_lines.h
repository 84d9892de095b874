// Lines of nodes in one direction and their coarsening: every second line plus the last, so that any number
// of lines at any spacing works.
#pragma once

#include <cstddef>
#include <vector>

namespace teletact::service {

// Strictly increasing coordinates of the node lines, >= 2 each.
struct NodeLines {
  std::vector<double> x, y;
  std::size_t nodes() const { return x.size() * y.size(); }
};

// Linear interpolation between the lines of a fine and a coarse level.
struct LineTransfer {
  std::vector<double> coarse;  // coordinates of the coarse lines
  std::vector<int> at;         // fine line of each coarse line
  std::vector<double> around;  // for each coarse line: weights of the fine lines just before and after it
  std::vector<int> left;       // coarse line at or before each fine line
  std::vector<double> weight;  // of coarse line left + 1 in each fine line
};

// Drops every second line as long as the interval left by it does not exceed `widest`: where lines already
// lie far apart, all are kept.
LineTransfer coarsen(const std::vector<double>& fine, double widest);

// The next coarser level in both directions. `spacing` is the fine level's nominal distance of lines, doubled
// until something coarsens; intervals grow to at most kWidestInterval times it. So stretched elements are
// coarsened across their short side first, until they are square: point smoothers fail on stretched ones.
struct GridTransfer {
  LineTransfer x, y;
};
GridTransfer coarsen(const NodeLines& fine, double& spacing);
constexpr double kWidestInterval = 3;

// Every second line of both directions, whatever the spacing.
GridTransfer coarsen_fully(const NodeLines& fine);

// Direction of the short side of elements, when some are stretched by more than kStretched one way and none
// is the other way.
enum class ShortSide { kNeither, kX, kY };
ShortSide short_side(const NodeLines&);
constexpr double kStretched = 2;

// Smallest distance between neighbouring lines of either direction.
double smallest_spacing(const NodeLines&);

}  // namespace teletact::service
