#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "service/device/cancellation.h"
#include "service/imaging/tracking/search.h"

namespace teletact::service {
namespace {

constexpr int kBlock = 8;  // lags that are worked on at once: the compiler's vectors

// Sums up over the four directions; per node `stride` lags, whole blocks, those that do not exist at
// infinity.
class Aggregator {
 public:
  Aggregator(const LagVolume& v, float slope_cost)
      : lags_(v.lag_count), stride_((v.lag_count + kBlock - 1) / kBlock * kBlock), slope_cost_(slope_cost) {
    const auto nodes = static_cast<std::size_t>(v.nx) * static_cast<std::size_t>(v.ny);
    grow(costs_, nodes * static_cast<std::size_t>(stride_), std::numeric_limits<float>::infinity());
    grow(sum_, costs_.size());
    for (std::size_t node = 0; node < nodes; ++node) {
      if (node % static_cast<std::size_t>(v.nx) == 0) check_cancelled();
      for (std::size_t d = 0; d < static_cast<std::size_t>(lags_); ++d)
        costs_[node * static_cast<std::size_t>(stride_) + d] =
            1 - v.correlation[node * static_cast<std::size_t>(lags_) + d];
    }
  }

  // Along one line of nodes: first, first + step, ...
  void along(int first, int step, int count, int reach) {
    check_cancelled();
    // `reach` cells of infinity on both sides stand for lags that do not exist.
    const auto size = static_cast<std::size_t>(stride_) + 2 * static_cast<std::size_t>(reach);
    before_.assign(size, std::numeric_limits<float>::infinity());
    now_ = before_;
    for (int n = 0; n < count; ++n) {
      const auto at = static_cast<std::size_t>(first + n * step) * static_cast<std::size_t>(stride_);
      float* const here = now_.data() + reach;
      if (n == 0)
        std::copy_n(costs_.data() + at, stride_, here);
      else
        advance(before_.data() + reach, costs_.data() + at, here, reach);
      float* const sum = sum_.data() + at;
      for (int d = 0; d < stride_; d += kBlock)
        for (int k = d; k < d + kBlock; ++k) sum[k] += here[k];
      std::swap(before_, now_);
    }
  }

  const float* sum(int node) const { return sum_.data() + node * static_cast<std::ptrdiff_t>(stride_); }

 private:
  // L(p, d) = C(p, d) + min_e (L(previous, d + e) + slope_cost |e|) - min L(previous, .)
  void advance(const float* __restrict before, const float* __restrict cost, float* __restrict here,
               int reach) const {
    float least[kBlock];
    std::copy_n(before, kBlock, least);
    for (int d = kBlock; d < stride_; d += kBlock)
      for (int k = 0; k < kBlock; ++k) least[k] = before[d + k] < least[k] ? before[d + k] : least[k];
    const float least_of_all = *std::min_element(least, least + kBlock);
    for (int d = 0; d < stride_; d += kBlock) {
      float best[kBlock];
      std::copy_n(before + d, kBlock, best);
      for (int e = 1; e <= reach; ++e) {
        const float penalty = slope_cost_ * static_cast<float>(e);
        for (int k = 0; k < kBlock; ++k) {
          const float below = before[d + k - e], above = before[d + k + e];
          const float other = (below < above ? below : above) + penalty;
          best[k] = other < best[k] ? other : best[k];
        }
      }
      for (int k = 0; k < kBlock; ++k) here[d + k] = best[k] + (cost[d + k] - least_of_all);
    }
  }

  std::vector<float> costs_, sum_, before_, now_;
  int lags_, stride_;
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

std::vector<float> find_paths(const LagVolume& v, int reach_down, int reach_across, float slope_cost) {
  Aggregator aggregate(v, slope_cost);
  for (int i = 0; i < v.nx; ++i) {
    aggregate.along(i, v.nx, v.ny, reach_down);
    aggregate.along(i + v.nx * (v.ny - 1), -v.nx, v.ny, reach_down);
  }
  for (int j = 0; j < v.ny; ++j) {
    aggregate.along(v.nx * j, 1, v.nx, reach_across);
    aggregate.along(v.nx * j + v.nx - 1, -1, v.nx, reach_across);
  }
  std::vector<float> path;
  path.reserve(static_cast<std::size_t>(v.nx) * static_cast<std::size_t>(v.ny));
  for (int node = 0; node < v.nx * v.ny; ++node) {
    if (node % v.nx == 0) check_cancelled();
    path.push_back(best_lag(aggregate.sum(node), v.lag_count));
  }
  return path;
}

}  // namespace teletact::service
