#include "service/solver/dense_inverse.h"

#include <Eigen/Core>
#include <cstddef>

namespace teletact::service {
namespace {

using Row = Eigen::Map<Eigen::ArrayXd>;

// Sweep operator (Goodnight 1979) on unknown k, of the lower triangle; after all sweeps the matrix is minus
// the inverse. column: scratch, n.
void sweep(std::vector<double>& a, std::size_t n, std::size_t k, Eigen::ArrayXd& column) {
  for (std::size_t j = 0; j < n; ++j) column[Eigen::Index(j)] = j < k ? a[k * n + j] : a[j * n + k];
  const double pivot = 1 / a[k * n + k];
  for (std::size_t i = 0; i < n; ++i) {
    if (i == k || column[Eigen::Index(i)] == 0) continue;  // most are, of a sparse matrix, until swept
    const double factor = column[Eigen::Index(i)] * pivot;
    Row(&a[i * n], Eigen::Index(i + 1)) -= factor * column.head(Eigen::Index(i + 1));
    if (i > k) a[i * n + k] = factor;
  }
  Row(&a[k * n], Eigen::Index(k)) = pivot * column.head(Eigen::Index(k));
  a[k * n + k] = -pivot;
}

}  // namespace

void invert_symmetric(std::vector<double>& matrix, std::size_t n) {
  constexpr double kSmallestPivot = 1e-13;
  std::vector<double> diagonal(n);
  for (std::size_t k = 0; k < n; ++k) diagonal[k] = matrix[k * n + k];
  std::vector<bool> left_out(n);
  Eigen::ArrayXd column(n);
  for (std::size_t k = 0; k < n; ++k) {
    left_out[k] = !(matrix[k * n + k] > kSmallestPivot * diagonal[k]);
    if (!left_out[k]) sweep(matrix, n, k, column);
  }
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j <= i; ++j)
      matrix[j * n + i] = matrix[i * n + j] = left_out[i] || left_out[j] ? 0 : -matrix[i * n + j];
}

}  // namespace teletact::service
