// What the solver knows of a problem: a symmetric positive definite operator on vectors of two unknowns per
// node, several vectors at a time.
#pragma once

#include <cstddef>
#include <memory>
#include <utility>

#include "service/device/device.h"

namespace teletact::service {

// Precision of a kernel program whose `real` is T.
template <class T>
constexpr Precision precision_of = sizeof(T) == sizeof(double) ? Precision::kDouble : Precision::kFloat;

template <class T>
class LinearOperator {
 public:
  virtual ~LinearOperator() = default;
  // y = A x for each of the first `count` vectors. Layout [vector][node][2], as all vectors here.
  virtual void apply(const Array<T>& x, Array<T>& y, std::size_t count) = 0;
};

// Work sizes of a kernel over (i, j, layer) of an nx x ny grid.
inline Range grid_range(std::size_t nx, std::size_t ny, std::size_t layers) {
  return {{nx, ny, layers}, {nx > 32 ? std::size_t{64} : std::size_t{16}, 1, 1}};
}

// The operator given by a 9-point stencil of 2x2 blocks (kernels/stencil.clh).
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
