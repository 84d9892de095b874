// The median, one copy for all.
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

namespace teletact::bench {

inline constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// The upper one of two middle ones; NaN for none.
template <class Real>
Real median_of(std::vector<Real> values) {
  if (values.empty()) return std::numeric_limits<Real>::quiet_NaN();
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace teletact::bench
