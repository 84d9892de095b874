#include "service/solver/stencil.h"

#include <utility>

namespace teletact::service {

template <class T>
StencilOperator<T>::StencilOperator(const Queue& queue, std::shared_ptr<const Array<T>> stencil,
                                    std::size_t nx, std::size_t ny)
    : stencil_(std::move(stencil)),
      nx_(nx),
      ny_(ny),
      apply_(queue.kernel("stencil", "stencil_apply", precision_of<T>)) {}

template <class T>
void StencilOperator<T>::apply(const Array<T>& x, Array<T>& y, std::size_t count) {
  apply_(grid_range(nx_, ny_, count), *stencil_, x, y, static_cast<int>(nx_), static_cast<int>(ny_));
}

template class StencilOperator<float>;
template class StencilOperator<double>;

}  // namespace teletact::service
