#include "service/imaging/tracking/node_gradients.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

namespace teletact::service {
namespace {

// Numbers of `marks`, as in kernels/node_gradients.cl.
constexpr std::size_t kGoesOn = 2, kIterations = 6, kRr = 7, kPartsOfProducts = 9;

constexpr std::size_t kGroupOfGpu = 128;
constexpr int kMostParts = 128;  // that every group adds up

}  // namespace

NodeGradients::NodeGradients(const Queue& queue, int nx, int ny)
    : queue_(queue), nx_(nx), ny_(ny), group_(queue.info().gpu ? kGroupOfGpu : 1) {
  const int nodes = nx * ny;
  chunk_ = std::max(static_cast<int>(kGroupOfGpu), (nodes + kMostParts - 1) / kMostParts);
  parts_ = (nodes + chunk_ - 1) / chunk_;
  const auto size = 2 * static_cast<std::size_t>(nodes);
  for (Array<float>* a : {&z_, &ap_, &p_[0], &p_[1]}) *a = queue.array<float>(size);
  curvature_ = queue.array<float>(static_cast<std::size_t>(parts_));
  marks_ = queue.array<float>(kPartsOfProducts + 2 * static_cast<std::size_t>(parts_));
  const Defines defines{{"GROUP", std::to_string(group_)}};
  const auto get = [&](const char* name) {
    return queue.kernel("node_gradients", name, Precision::kFloat, defines);
  };
  step_ = get("node_step");
  turn_ = get("node_turn");
}

PcgResult NodeGradients::solve(const Array<float>& stencil, Array<float>& r, Array<float>& x,
                               const PcgOptions& options) {
  if (options.look_every == 0)
    throw std::invalid_argument("NodeGradients: look_every is 0; it must be at least 1");
  const auto tolerance = static_cast<float>(options.relative_residual * options.relative_residual);
  const Range range{
      {static_cast<std::size_t>(parts_) * group_}, {group_}, static_cast<std::size_t>(chunk_) / group_};
  const auto step = [&](std::size_t k, int start) {
    step_(range, stencil, p_[k % 2], ap_, x, r, z_, curvature_, marks_, nx_ * ny_, chunk_, parts_,
          static_cast<int>(k % 2), static_cast<int>(k), start);
  };
  step(0, 1);
  for (std::size_t k = 0;; ++k) {
    turn_(range, stencil, z_, p_[(k + 1) % 2], p_[k % 2], ap_, curvature_, marks_, tolerance, nx_, ny_,
          chunk_, parts_, static_cast<int>(k % 2), k == 0 ? 1 : 0);
    const bool last = k == options.max_iterations;
    if (last || (k >= expected_ && (k - expected_) % options.look_every == 0)) {
      std::vector<float> marks(kPartsOfProducts);
      queue_.read(marks_, marks.data(), marks.size());
      const auto state = static_cast<StopReason>(static_cast<int>(marks[kGoesOn + k % 2]));
      if (last || state != StopReason::kRunning) {
        PcgResult result;
        result.reason = state == StopReason::kRunning ? StopReason::kIterationLimit : state;
        result.iterations = static_cast<std::size_t>(marks[kIterations]);
        expected_ = std::max<std::size_t>(1, result.iterations);
        result.recursive_residual = std::sqrt(static_cast<double>(marks[kRr]));
        return result;
      }
    }
    step(k, 0);
  }
}

}  // namespace teletact::service
