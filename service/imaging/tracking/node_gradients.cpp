#include "service/imaging/tracking/node_gradients.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace teletact::service {
namespace {

// Numbers that say how a solve ended, as in kernels/node_gradients.cl.
constexpr std::size_t kState = 0, kIterations = 1, kRr = 2;

constexpr std::size_t kGroupOfGpu = 512;
// Of one launch, which cannot be cancelled: on a processor, where a vector takes some 30 ns, up to 20 ms.
constexpr std::size_t kMostVectors = std::size_t{1} << 19, kMostTermsOfGpu = 1024, kLeastIterations = 16;

std::size_t group_of(const DeviceInfo& info) {
  std::size_t group = 1;
  while (info.gpu && 2 * group <= std::min(info.max_group, kGroupOfGpu)) group *= 2;
  return group;
}

}  // namespace

NodeLayout::NodeLayout(int nx, int ny, std::size_t width)
    : stride(nx + 1),
      count(static_cast<int>(
          (2 * static_cast<std::size_t>(stride) * static_cast<std::size_t>(ny) + width - 1) / width)),
      size(2 * 2 * static_cast<std::size_t>(stride) + static_cast<std::size_t>(count) * width) {}

NodeGradients::NodeGradients(const Queue& queue, int nx, int ny)
    : queue_(queue),
      group_(group_of(queue.info())),
      width_(std::clamp<std::size_t>(queue.info().width<float>(), 2, 16)),
      layout_(nx, ny, width_),
      z_(array()),
      p_(array()),
      ap_(array()),
      solve_(queue.kernel("node_gradients", "node_gradients", Precision::kFloat,
                          {{"GROUP", std::to_string(group_)}, {"WIDTH", std::to_string(width_)}})) {}

Array<float> NodeGradients::array() const {
  Array<float> zeros = queue_.array<float>(layout_.size);
  queue_.fill_zero(zeros);
  return zeros;
}

void NodeGradients::solve(const NodeSystem& system, Array<float>& r, Array<float>& x, Array<float>& ends,
                          std::size_t at, const PcgOptions& options) {
  if (options.max_iterations == 0)
    throw std::invalid_argument("NodeGradients: max_iterations is 0; it must be at least 1");
  const auto tolerance = static_cast<float>(options.relative_residual * options.relative_residual);
  const std::size_t terms = (static_cast<std::size_t>(layout_.count) + group_ - 1) / group_,
                    most = queue_.info().gpu ? kMostTermsOfGpu : kMostVectors,
                    at_once = std::max(most / terms, kLeastIterations);
  for (std::size_t first = 0; first < options.max_iterations; first += at_once) {
    const std::size_t last = std::min(first + at_once, options.max_iterations);
    solve_({{group_}, {group_}, terms * (last - first)}, system.diagonal, system.cross, system.weights, r, x,
           z_, p_, ap_, ends, static_cast<int>(at), tolerance, layout_.stride, layout_.count,
           static_cast<int>(first), static_cast<int>(last));
  }
}

PcgResult NodeGradients::result(const float* end) {
  PcgResult result;
  const auto state = static_cast<StopReason>(static_cast<int>(end[kState]));
  result.reason = state == StopReason::kRunning ? StopReason::kIterationLimit : state;
  result.iterations = static_cast<std::size_t>(end[kIterations]);
  result.recursive_residual = std::sqrt(static_cast<double>(end[kRr]));
  return result;
}

}  // namespace teletact::service
