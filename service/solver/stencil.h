// The operator given by a 9-point stencil of 2x2 blocks (kernels/stencil.clh).
#pragma once

#include <memory>
#include <utility>

#include "service/solver/linear_operator.h"

namespace teletact::service {

template <class T>
class StencilOperator : public LinearOperator<T> {
 public:
  // stencil: [9][ny][nx] blocks of 4. Shared with the caller, who may rewrite it.
  StencilOperator(const Queue& queue, std::shared_ptr<const Array<T>> stencil, std::size_t nx, std::size_t ny)
      : stencil_(std::move(stencil)),
        nx_(nx),
        ny_(ny),
        apply_(queue.kernel("stencil", "stencil_apply", precision_of<T>)) {}
  void apply(const Array<T>& x, Array<T>& y, std::size_t count) override {
    apply_(grid_range(nx_, ny_, count), *stencil_, x, y, static_cast<int>(nx_), static_cast<int>(ny_));
  }

 private:
  std::shared_ptr<const Array<T>> stencil_;
  std::size_t nx_, ny_;
  Kernel apply_;
};

}  // namespace teletact::service
