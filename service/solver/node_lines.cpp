#include "service/solver/node_lines.h"

#include <algorithm>

namespace teletact::service {

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

double smallest_spacing(const NodeLines& lines) {
  double smallest = lines.x[1] - lines.x[0];
  for (const std::vector<double>* line : {&lines.x, &lines.y})
    for (std::size_t i = 0; i + 1 < line->size(); ++i)
      smallest = std::min(smallest, (*line)[i + 1] - (*line)[i]);
  return smallest;
}

}  // namespace teletact::service
