// Conjugate gradients on a narrow tissue grid, a whole solve of many right-hand sides in one launch
// (kernels/block_tridiagonal.cl): the preconditioner is the inverse of the operator, rounded to T, which the
// host makes in double by eliminating one line of nodes after the other (T4.2).
#pragma once

#include <cstddef>
#include <vector>

#include "service/solver/pcg.h"
#include "service/tissue/elasticity.h"

namespace teletact::service {

// Where it takes the place of multigrid: the grid's short side has few nodes, or some and elements are
// stretched.
bool is_narrow(const DeviceInfo&, const TissueGrid&);

// As Pcg, with its preconditioner. In double a solve is one step: as far as double goes, and the caller's own
// bound of what is left costs no more than to look here.
template <class T>
class BlockTridiagonalPcg {
 public:
  // Throws std::invalid_argument when the operator is found not to be positive definite.
  BlockTridiagonalPcg(const Queue&, const ScaledTissue&, const PcgOptions&);
  void reserve(std::size_t count);
  std::vector<PcgResult> solve(std::size_t count, Array<T>& r, const Array<T>& load, Array<T>& x,
                               const std::vector<double>& initial_energy,
                               const std::vector<double>& absolute_error);
  // z = M r, and r . z of each.
  std::vector<double> apply(std::size_t count, const Array<T>& r, Array<T>& z);
  void set_relative_error(double error) { options_.relative_error = error; }

 private:
  static constexpr bool kOneStep = sizeof(T) == sizeof(double);
  // As in the kernel.
  struct Shape {
    int steps = 0, size = 0, padded = 0, along = 0, across = 0, rhs = 0;
  };
  Shape shape_of(std::size_t count) const;
  Range range(std::size_t count, std::size_t sweeps) const;
  Queue queue_;
  PcgOptions options_;
  Shape shape_;
  std::size_t width_, group_, unknowns_, capacity_ = 0;
  Array<T> rows_, inverses_, work_, scalars_;
  Kernel solve_, apply_;
};

}  // namespace teletact::service
