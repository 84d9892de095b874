// What the solver knows of a problem: a symmetric positive definite operator on vectors of two unknowns per
// node, several vectors at a time.
#pragma once

#include <cstddef>

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

}  // namespace teletact::service
