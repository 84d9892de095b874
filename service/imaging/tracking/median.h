// The median of very many values: it looks up meanwhile (service/device/cancellation.h).
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "service/device/cancellation.h"

namespace teletact::service {

// The upper of two middle ones; 0 of none. Leaves the values in another order.
template <class T>
double median(std::vector<T>& values) {
  constexpr std::ptrdiff_t kAtOnce = 1 << 18;
  if (values.empty()) return 0;
  auto first = values.begin(), last = values.end();
  const auto middle = first + static_cast<std::ptrdiff_t>(values.size() / 2);
  while (last - first > kAtOnce) {
    check_cancelled();
    const T pivot = first[(last - first) / 2];
    const auto equal = std::partition(first, last, [pivot](T v) { return v < pivot; });
    const auto above = std::partition(equal, last, [pivot](T v) { return !(pivot < v); });
    if (middle < equal)
      last = equal;
    else if (middle < above)
      return pivot;
    else
      first = above;
  }
  std::nth_element(first, middle, last);
  return *middle;
}

}  // namespace teletact::service
