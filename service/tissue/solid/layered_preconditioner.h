// The exact solver of layered tissue on the device (T8.1): what conjugate gradients on solid tissue are
// preconditioned with. A condition on the surface enters between the two sweeps, at no second solve.
#pragma once

#include <cstddef>
#include <optional>

#include "service/device/device.h"
#include "service/solver/fourier.h"
#include "service/solver/linear_operator.h"
#include "service/tissue/solid/surface_compliance.h"

namespace teletact::service {

// Fields: [plane = 3 row + component][z][x]. The surface's are the first three planes.
template <class T>
class LayeredPreconditioner {
 public:
  // Components of the surface that are constrained: planes [first, first + count).
  struct Components {
    std::size_t first = 1, count = 1;
  };
  LayeredPreconditioner(const Queue&, const SolidGrid&, const LayeredTissue&, double poisson_ratio);
  // Eliminates r up to the surface; `surface`: how that would move if it were free, the planes of
  // `components` alone.
  void up(const Array<T>& r, const Components&, Array<T>& surface);
  // z with the forces in these planes of `surface` added to the r that was eliminated.
  void down(const Array<T>& surface, const Components&, Array<T>& z);
  // How layered tissue moves under surface forces alone.
  void solve_surface(const Array<T>& surface, const Components&, Array<T>& z);
  // Of the layered surface, offsets up to half of the block.
  const SurfaceCompliance& surface_compliance() const { return *compliance_; }

 private:
  Queue queue_;
  int layers_, nz_;
  Fourier<T> fourier_, surface_fourier_;
  Array<T> inverse_, coupling_, spectrum_, surface_;
  std::optional<SurfaceCompliance> compliance_;
  Range range_;
  Kernel up_, down_;
};

}  // namespace teletact::service
