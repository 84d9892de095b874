#include "service/solver/patches.h"

namespace teletact::service {

template <class S>
Array<S> inverse_patches(const Queue& queue, const Array<S>& stencil, std::size_t nx, std::size_t ny,
                         Array<int>& indefinite) {
  const int columns = static_cast<int>(nx), rows = static_cast<int>(ny);
  auto inverse = queue.array<S>(64 * (nx - 1) * (ny - 1));
  queue.kernel("patches", "invert_patches", precision_of<S>)(grid_range(nx - 1, ny - 1, 1), stencil, inverse,
                                                             indefinite, columns, rows);
  auto sum = queue.array<S>(36 * nx * ny);
  queue.kernel("patches", "gather_patches", precision_of<S>)(grid_range(nx, ny, 9), inverse, sum, columns,
                                                             rows);
  return sum;
}

template Array<float> inverse_patches(const Queue&, const Array<float>&, std::size_t, std::size_t,
                                      Array<int>&);
template Array<double> inverse_patches(const Queue&, const Array<double>&, std::size_t, std::size_t,
                                       Array<int>&);

}  // namespace teletact::service
