#include "service/solver/dense_inverse.h"

#include <cstddef>

namespace teletact::service {
namespace {

// Sweep operator (Goodnight 1979) on unknown k; after all sweeps the matrix is minus the inverse.
void sweep(std::vector<double>& a, std::size_t n, std::size_t k) {
  const double pivot = 1 / a[k * n + k];
  double* row_k = &a[k * n];
  for (std::size_t i = 0; i < n; ++i) {
    if (i == k) continue;
    const double factor = a[i * n + k] * pivot;
    double* row = &a[i * n];
    for (std::size_t j = 0; j < n; ++j) row[j] -= factor * row_k[j];
    row[k] = factor;
  }
  for (std::size_t j = 0; j < n; ++j) row_k[j] *= pivot;
  row_k[k] = -pivot;
}

}  // namespace

void invert_symmetric(std::vector<double>& matrix, std::size_t n, double smallest_pivot) {
  std::vector<double> diagonal(n);
  for (std::size_t k = 0; k < n; ++k) diagonal[k] = matrix[k * n + k];
  std::vector<bool> left_out(n);
  for (std::size_t k = 0; k < n; ++k) {
    left_out[k] = !(matrix[k * n + k] > smallest_pivot * diagonal[k]);
    if (!left_out[k]) sweep(matrix, n, k);
  }
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j < n; ++j)
      matrix[i * n + j] = left_out[i] || left_out[j] ? 0 : -matrix[i * n + j];
}

}  // namespace teletact::service
