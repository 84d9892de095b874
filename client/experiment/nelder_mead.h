// Nelder and Mead's downhill simplex (Computer Journal 7, 1965), with its standard coefficients.
#pragma once

#include <array>
#include <cstddef>
#include <functional>

namespace teletact::client {

constexpr std::size_t kParametersMax = 3;
using Parameters = std::array<double, kParametersMax>;  // only the first `dimensions` are used

struct NelderMeadOptions {
  double first_step = 0.2;      // of the first simplex, in every parameter
  double tolerance = 1e-9;      // ends when the simplex is no wider than this
  unsigned evaluations = 2000;  // at most
};

struct NelderMeadResult {
  Parameters at{};
  double value = 0;
  unsigned evaluations = 0;
  bool converged = false;  // ended by the tolerance
};

// Least value of `cost` found from `start`; 1 <= dimensions <= kParametersMax. `cost` may be infinite where
// it is not defined, and finite at the start. Throws std::invalid_argument when it is not finite there.
NelderMeadResult nelder_mead(const std::function<double(const Parameters&)>& cost, const Parameters& start,
                             std::size_t dimensions, const NelderMeadOptions& = {});

}  // namespace teletact::client
