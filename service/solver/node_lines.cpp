#include "service/solver/node_lines.h"

#include <algorithm>
#include <limits>
#include <utility>

namespace teletact::service {
namespace {

// Least and most distance between neighbouring lines.
std::pair<double, double> spacings(const std::vector<double>& lines) {
  std::pair<double, double> found{lines[1] - lines[0], lines[1] - lines[0]};
  for (std::size_t i = 1; i + 1 < lines.size(); ++i) {
    found.first = std::min(found.first, lines[i + 1] - lines[i]);
    found.second = std::max(found.second, lines[i + 1] - lines[i]);
  }
  return found;
}

}  // namespace

LineTransfer coarsen(const std::vector<double>& fine, double widest) {
  LineTransfer t;
  const std::size_t count = fine.size();
  for (std::size_t i = 0; i < count;) {
    t.at.push_back(static_cast<int>(i));
    i += i + 2 < count && fine[i + 2] - fine[i] <= widest ? 2 : 1;
  }
  for (const int i : t.at) t.coarse.push_back(fine[static_cast<std::size_t>(i)]);
  t.around.assign(2 * t.at.size(), 0.0);
  for (std::size_t i = 0, c = 0; i < count; ++i) {
    if (c + 1 < t.at.size() && static_cast<int>(i) == t.at[c + 1]) ++c;
    const bool coincides = static_cast<int>(i) == t.at[c];
    const double weight = coincides ? 0 : (fine[i] - t.coarse[c]) / (t.coarse[c + 1] - t.coarse[c]);
    t.left.push_back(static_cast<int>(c));
    t.weight.push_back(weight);
    if (coincides) continue;
    t.around[2 * c + 1] = 1 - weight;
    t.around[2 * (c + 1)] = weight;
  }
  return t;
}

GridTransfer coarsen(const NodeLines& fine, double& spacing) {
  const double extent = std::max(fine.x.back() - fine.x.front(), fine.y.back() - fine.y.front());
  for (;; spacing *= 2) {
    GridTransfer t{coarsen(fine.x, kWidestInterval * spacing), coarsen(fine.y, kWidestInterval * spacing)};
    const bool coarser = t.x.at.size() < fine.x.size() || t.y.at.size() < fine.y.size();
    if (coarser || spacing > extent) return t;
  }
}

GridTransfer coarsen_fully(const NodeLines& fine) {
  constexpr double kAny = std::numeric_limits<double>::infinity();
  return {coarsen(fine.x, kAny), coarsen(fine.y, kAny)};
}

ShortSide short_side(const NodeLines& lines) {
  const auto [min_x, max_x] = spacings(lines.x);
  const auto [min_y, max_y] = spacings(lines.y);
  const bool tall = max_y > kStretched * min_x, wide = max_x > kStretched * min_y;
  return tall == wide ? ShortSide::kNeither : tall ? ShortSide::kX : ShortSide::kY;
}

double smallest_spacing(const NodeLines& lines) {
  return std::min(spacings(lines.x).first, spacings(lines.y).first);
}

}  // namespace teletact::service
