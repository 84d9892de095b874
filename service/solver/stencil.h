// The operator given by a 9-point stencil of 2x2 blocks (kernels/stencil.clh).
#pragma once

#include "service/solver/linear_operator.h"

namespace teletact::service {

template <class T>
class StencilOperator : public LinearOperator<T> {
 public:
  // stencil: [9][ny][nx] blocks of 4. Shared with the caller, who may rewrite it.
  StencilOperator(const Queue&, std::shared_ptr<const Array<T>> stencil, std::size_t nx, std::size_t ny);
  void apply(const Array<T>& x, Array<T>& y, std::size_t count) override;

 private:
  std::shared_ptr<const Array<T>> stencil_;
  std::size_t nx_, ny_;
  Kernel apply_;
};

}  // namespace teletact::service
