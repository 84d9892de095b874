// Layered tissue solved by Fourier transforms (T8.1): with E = E0(y) the stiffness K0 couples, for each pair
// of wave numbers along x and z, only the rows of nodes: one block tridiagonal system of 3 x 3 blocks. It is
// eliminated from the held bottom up, so that the surface comes last.
//
// With u_y times i the blocks are real, by the element's mirror symmetries; and those of -kz are those of kz
// with u_z's sign turned. So a quarter of the numbers is kept.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "service/device/device.h"
#include "service/solver/fourier.h"
#include "service/solver/linear_operator.h"
#include "service/tissue/solid/solid_tissue.h"
#include "service/tissue/solid/surface_compliance.h"

namespace teletact::service {

// Of S_j, what row j feels with all below it eliminated: its inverse, [row][6 = xx, xy, xz, yy, yz, zz], and
// W_j = S_(j+1)^-1 K0(j+1, j), [row][9, row-major] for all rows but the last; each [kz = 0 .. nz/2][pitch]
// over kx = 0 .. nx/2, zero beyond.
struct LayeredFactor {
  std::size_t pitch = 0;
  std::vector<double> inverse, coupling;
};

// `pitch`: numbers in a row, > nx / 2.
LayeredFactor factor(const SolidGrid&, const LayeredTissue&, double poisson_ratio, std::size_t pitch);

// The transformed compliance of a row of nodes, what lies above it and below in the model,
// [6][kz = 0 .. nz/2][pitch]: of the surface S_0^-1, of row j + 1 S_(j+1)^-1 + W_j G_j W_j^T, G_j that of
// row j.
std::vector<double> row_symbol(const SolidGrid&, const LayeredTissue&, double poisson_ratio,
                               std::size_t pitch, std::size_t row = 0);

// The exact solver of layered tissue on the device (T8.1): what conjugate gradients on solid tissue are
// preconditioned with. A condition on the surface enters between the two sweeps, at no second solve.
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
  // up() and down() between the transforms of r and z, which are `spectrum`'s, and of the surface's planes of
  // `components`.
  void eliminate(const Components&);
  void substitute(const Components&);
  Array<T>& spectrum() { return spectrum_; }
  Array<T>& surface_spectrum() { return surface_; }
  Fourier<T>& fourier() { return fourier_; }
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
