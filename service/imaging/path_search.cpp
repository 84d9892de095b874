#include "service/imaging/path_search.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace teletact::service {
namespace {

using Costs = std::vector<float>;

// 1 - correlation of the best lateral lag, [node][lag].
Costs matching_costs(const LagVolume& v) {
  const auto nodes = static_cast<std::size_t>(v.nx * v.ny);
  const auto lags = static_cast<std::size_t>(v.lag_count),
             laterals = static_cast<std::size_t>(v.lateral_count);
  Costs costs(nodes * lags);
  for (std::size_t node = 0; node < nodes; ++node) {
    const float* const c = v.correlation.data() + node * laterals * lags;
    float* const out = costs.data() + node * lags;
    for (std::size_t d = 0; d < lags; ++d) out[d] = 1 - c[d];
    for (std::size_t m = 1; m < laterals; ++m)
      for (std::size_t d = 0; d < lags; ++d) out[d] = std::min(out[d], 1 - c[m * lags + d]);
  }
  return costs;
}

// Aggregates along one line of nodes (first, first + step, ...) and adds it to `sum`.
class Aggregator {
 public:
  Aggregator(const Costs& costs, Costs& sum, int lags, float slope_cost)
      : costs_(costs), sum_(sum), lags_(lags), slope_cost_(slope_cost) {}

  void along(int first, int step, int count, int reach) {
    // `reach` cells of infinity on both sides stand for lags that do not exist.
    const auto size = static_cast<std::size_t>(lags_ + 2 * reach);
    Costs before(size, std::numeric_limits<float>::infinity()), now = before;
    for (int n = 0; n < count; ++n) {
      const auto at = static_cast<std::size_t>(first + n * step) * static_cast<std::size_t>(lags_);
      float* const here = now.data() + reach;
      if (n == 0) {
        std::copy_n(costs_.data() + at, lags_, here);
      } else {
        advance(before.data() + reach, costs_.data() + at, here, reach);
      }
      for (int d = 0; d < lags_; ++d) sum_[at + static_cast<std::size_t>(d)] += here[d];
      std::swap(before, now);
    }
  }

 private:
  // L(p, d) = C(p, d) + min_e (L(previous, d + e) + slope_cost |e|) - min L(previous, .)
  void advance(const float* before, const float* cost, float* here, int reach) const {
    const float least = *std::min_element(before, before + lags_);
    std::copy_n(before, lags_, here);
    for (int e = 1; e <= reach; ++e) {
      const float penalty = slope_cost_ * static_cast<float>(e);
      for (int d = 0; d < lags_; ++d)
        here[d] = std::min(here[d], std::min(before[d - e], before[d + e]) + penalty);
    }
    for (int d = 0; d < lags_; ++d) here[d] += cost[d] - least;
  }

  const Costs& costs_;
  Costs& sum_;
  int lags_;
  float slope_cost_;
};

float best_lag(const float* cost, int lags) {
  const int best = static_cast<int>(std::min_element(cost, cost + lags) - cost);
  if (best == 0 || best == lags - 1) return static_cast<float>(best);
  const float before = cost[best - 1], after = cost[best + 1];
  const float curvature = before - 2 * cost[best] + after;
  const float fraction =
      curvature > 1e-6f ? std::clamp(0.5f * (before - after) / curvature, -0.5f, 0.5f) : 0.0f;
  return static_cast<float>(best) + fraction;
}

}  // namespace

std::vector<float> find_paths(const LagVolume& v, int axial_reach, int lateral_reach, float slope_cost) {
  const Costs costs = matching_costs(v);
  Costs sum(costs.size(), 0.0f);
  Aggregator aggregate(costs, sum, v.lag_count, slope_cost);
  for (int i = 0; i < v.nx; ++i) {
    aggregate.along(i, v.nx, v.ny, axial_reach);
    aggregate.along(i + v.nx * (v.ny - 1), -v.nx, v.ny, axial_reach);
  }
  for (int j = 0; j < v.ny; ++j) {
    aggregate.along(v.nx * j, 1, v.nx, lateral_reach);
    aggregate.along(v.nx * j + v.nx - 1, -1, v.nx, lateral_reach);
  }
  std::vector<float> path(static_cast<std::size_t>(v.nx * v.ny));
  for (std::size_t node = 0; node < path.size(); ++node)
    path[node] = best_lag(sum.data() + node * static_cast<std::size_t>(v.lag_count), v.lag_count);
  return path;
}

std::vector<float> find_lateral_paths(const LagVolume& v, const std::vector<float>& axial, float slope_cost) {
  const auto lags = static_cast<std::size_t>(v.lag_count);
  LagVolume lateral{v.nx, v.ny, 1, v.lateral_count, {}};
  for (std::size_t node = 0; node < axial.size(); ++node) {
    const auto lag = static_cast<std::size_t>(std::lround(axial[node]));
    for (int m = 0; m < v.lateral_count; ++m)
      lateral.correlation.push_back(
          v.correlation[(node * static_cast<std::size_t>(v.lateral_count) + static_cast<std::size_t>(m)) *
                            lags +
                        lag]);
  }
  return find_paths(lateral, 1, 1, slope_cost);
}

}  // namespace teletact::service
