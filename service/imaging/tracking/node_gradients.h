// Conjugate gradients for a refinement step (T2.3): one right-hand side, a 9-point stencil, the nodes' own
// blocks as preconditioner, two launches an iteration (kernels/node_gradients.cl). The smoothing reaches over
// a few nodes at most, so that a multigrid cycle saves three of four iterations and costs more than it saves.
#pragma once

#include <array>

#include "service/device/device.h"
#include "service/solver/pcg.h"

namespace teletact::service {

class NodeGradients {
 public:
  NodeGradients(const Queue&, int nx, int ny);
  // x of A x = r from x = 0, up to ||r|| / ||r_0|| = options.relative_residual; r: out, the residual. Of the
  // result what says why and when it stopped. When it looks changes nothing: where the last one ended, then
  // every options.look_every iterations. Throws std::invalid_argument unless that is at least 1.
  PcgResult solve(const Array<float>& stencil, Array<float>& r, Array<float>& x, const PcgOptions& options);

 private:
  Queue queue_;
  int nx_, ny_, chunk_, parts_;
  std::size_t group_, expected_ = 1;  // iterations
  Array<float> z_, ap_, curvature_, marks_;
  std::array<Array<float>, 2> p_;
  Kernel step_, turn_;
};

}  // namespace teletact::service
