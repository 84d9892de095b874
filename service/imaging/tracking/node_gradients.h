// Conjugate gradients for a refinement step (T2.3): one right-hand side, a block per node and constant
// weights to the four beside it, the nodes' own blocks as preconditioner, a whole solve in one launch of one
// work-group (kernels/node_gradients.cl). The smoothing reaches over a few nodes at most, so that a multigrid
// cycle saves three of four iterations and costs more than it saves.
#pragma once

#include <cstddef>

#include "service/device/device.h"
#include "service/solver/pcg.h"

namespace teletact::service {

// Where the numbers of a node stand, two each: i + stride (j + 1), between nodes that are none and stay zero.
struct NodeLayout {
  NodeLayout(int nx, int ny, std::size_t width);
  int stride, count;  // nodes from one row to the next; vectors of `width` numbers from the first node on
  std::size_t size;   // numbers
};

// A x = r; weights: of the edges along i, of those along j, lateral and axial each.
struct NodeSystem {
  const Array<float>&diagonal, &cross;  // of the nodes' own blocks; both sides of the diagonal
  const Array<float>& weights;
};

class NodeGradients {
 public:
  static constexpr std::size_t kEnd = 6;  // numbers that say how a solve ended
  NodeGradients(const Queue&, int nx, int ny);
  // x from x = 0, up to ||r|| / ||r_0|| = options.relative_residual; r: out, the residual. Reads nothing:
  // the kEnd numbers of `ends` from `at` on become what result() understands.
  void solve(const NodeSystem&, Array<float>& r, Array<float>& x, Array<float>& ends, std::size_t at,
             const PcgOptions& options);
  // Why and when it stopped.
  static PcgResult result(const float* end);
  const NodeLayout& layout() const { return layout_; }
  Array<float> array() const;  // zeros, in the layout

 private:
  Queue queue_;
  std::size_t group_, width_;
  NodeLayout layout_;
  Array<float> z_, p_, ap_;
  Kernel solve_;
};

}  // namespace teletact::service
