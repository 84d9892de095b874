#include "service/solver/node_lines.h"

namespace teletact::service {

LineTransfer coarsen(const std::vector<double>& fine) {
  LineTransfer t;
  const std::size_t count = fine.size(), step = count <= 3 ? 1 : 2;
  for (std::size_t i = 0; i < count; i += step) t.at.push_back(static_cast<int>(i));
  if (t.at.back() + 1 != static_cast<int>(count)) t.at.push_back(static_cast<int>(count) - 1);
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

}  // namespace teletact::service
