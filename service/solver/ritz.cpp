#include "service/solver/ritz.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace teletact::service {
namespace {

// Whether the tridiagonal matrix less `shift` is positive definite: all pivots of its LDL^T are positive.
bool positive_definite(const std::vector<double>& diagonal, const std::vector<double>& squared_off,
                       double shift) {
  double pivot = 1;
  for (std::size_t k = 0; k < diagonal.size(); ++k) {
    pivot = diagonal[k] - shift - (k ? squared_off[k - 1] / pivot : 0);
    if (!(pivot > 0)) return false;
  }
  return true;
}

}  // namespace

double smallest_ritz_value(const Lanczos& lanczos) {
  std::vector<double> diagonal, squared_off;
  double highest = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < lanczos.alpha.size(); ++k) {
    if (!(lanczos.alpha[k] > 0)) break;  // the step that stopped it
    diagonal.push_back(1 / lanczos.alpha[k] + (k ? lanczos.beta[k - 1] / lanczos.alpha[k - 1] : 0));
    squared_off.push_back(lanczos.beta[k] / (lanczos.alpha[k] * lanczos.alpha[k]));
    highest = std::min(highest, diagonal.back());
  }
  if (diagonal.empty()) return 0;
  double lowest = 0;
  for (int step = 0; step < 40; ++step) {
    const double middle = (lowest + highest) / 2;
    (positive_definite(diagonal, squared_off, middle) ? lowest : highest) = middle;
  }
  return highest;
}

}  // namespace teletact::service
