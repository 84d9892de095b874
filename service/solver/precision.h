// An array in another precision.
#pragma once

#include <type_traits>

#include "service/solver/linear_operator.h"

namespace teletact::service {

// A copy of `from` as T: S or float.
template <class T, class S>
Array<T> converted(const Queue& queue, const Array<S>& from) {
  auto to = queue.array<T>(from.size());
  if constexpr (std::is_same_v<S, T>)
    queue.copy(from, to);
  else
    queue.kernel("galerkin", "to_float", precision_of<S>)({{from.size()}, {64}}, from, to,
                                                          static_cast<int>(from.size()));
  return to;
}

}  // namespace teletact::service
