#include "service/tissue/solid/layered_preconditioner.h"

#include <algorithm>
#include <string>
#include <vector>

#include "service/tissue/solid/layered_factor.h"

namespace teletact::service {
namespace {

constexpr std::size_t kWidth = 8;  // a row of a spectrum is a multiple of it

}  // namespace

template <class T>
LayeredPreconditioner<T>::LayeredPreconditioner(const Queue& queue, const SolidGrid& grid,
                                                const LayeredTissue& tissue, double poisson_ratio)
    : queue_(queue),
      layers_(static_cast<int>(grid.layers())),
      nz_(static_cast<int>(grid.nz)),
      fourier_(queue, grid.nx, grid.nz, 3 * grid.layers()),
      surface_fourier_(queue, grid.nx, grid.nz, 3) {
  const LayeredFactor f = factor(grid, tissue, poisson_ratio, fourier_.pitch());
  compliance_.emplace(grid.nx, grid.nz, f.inverse, f.pitch, grid.nx, grid.nz);
  inverse_ = queue.array(std::vector<T>(f.inverse.begin(), f.inverse.end()));
  coupling_ = queue.array(std::vector<T>(f.coupling.begin(), f.coupling.end()));
  spectrum_ = queue.array<T>(fourier_.spectrum_size());
  surface_ = queue.array<T>(surface_fourier_.spectrum_size());
  queue_.fill_zero(surface_);
  const std::size_t width = queue.info().vector_bytes > sizeof(float) ? kWidth : 1;
  const Defines defines{{"WIDTH", std::to_string(width)}};
  up_ = queue.kernel("layers", "layers_up", precision_of<T>, defines);
  down_ = queue.kernel("layers", "layers_down", precision_of<T>, defines);
  range_ = {{fourier_.pitch() / width, grid.nz}, {1, 1}};
}

template <class T>
void LayeredPreconditioner<T>::up(const Array<T>& r, const Components& components, Array<T>& surface) {
  fourier_.forward(r, spectrum_, 0, static_cast<std::size_t>(3 * layers_));
  up_(range_, inverse_, coupling_, spectrum_, surface_, layers_, nz_, static_cast<int>(fourier_.pitch()),
      static_cast<int>(components.first), static_cast<int>(components.count));
  surface_fourier_.backward(surface_, surface, components.first, components.count);
}

template <class T>
void LayeredPreconditioner<T>::down(const Array<T>& surface, const Components& components, Array<T>& z) {
  surface_fourier_.forward(surface, surface_, components.first, components.count);
  down_(range_, inverse_, coupling_, spectrum_, surface_, layers_, nz_, static_cast<int>(fourier_.pitch()),
        static_cast<int>(components.first), static_cast<int>(components.count));
  fourier_.backward(spectrum_, z, 0, static_cast<std::size_t>(3 * layers_));
}

template <class T>
void LayeredPreconditioner<T>::solve_surface(const Array<T>& surface, const Components& components,
                                             Array<T>& z) {
  queue_.fill_zero(spectrum_);
  down(surface, components, z);
}

template class LayeredPreconditioner<float>;
template class LayeredPreconditioner<double>;

}  // namespace teletact::service
