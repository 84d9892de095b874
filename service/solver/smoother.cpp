#include "service/solver/smoother.h"

#include <Eigen/Core>

#include <cstddef>
#include <string>

namespace teletact::service {

template <class S, class W>
void cell_smoother(const Queue& queue, const Array<S>& stencil, std::size_t nx, std::size_t ny,
                   Array<int>& indefinite, Array<W>& planes, int at, int stride) {
  const int columns = static_cast<int>(nx), rows = static_cast<int>(ny);
  const std::size_t width = queue.info().width<S>(), items = (nx - 1 + width - 1) / width;
  Defines defines = planes_of<W>();
  defines["WIDTH"] = std::to_string(width);
  const auto kernel = [&](const char* name) { return queue.kernel("cells", name, precision_of<S>, defines); };
  auto inverse = queue.array<S>(36 * width * items * (ny - 1));
  kernel("invert_cells")(grid_range(items, ny - 1, 1), stencil, inverse, indefinite, columns, rows);
  kernel("gather_cells")({{static_cast<std::size_t>(stride)}, {64}}, inverse, planes, at, stride, columns,
                         rows);
}

template <class S>
Array<S> line_factor(const Queue& queue, const Array<S>& stencil, std::size_t nx, std::size_t ny,
                     bool along_x, Array<int>& indefinite) {
  const std::size_t steps = along_x ? nx : ny, lines = (along_x ? ny : nx) - 1;
  auto factor = queue.array<S>(32 * steps * lines);
  queue.kernel("lines", "factor_lines", precision_of<S>)({{lines}, {8}}, stencil, factor, indefinite,
                                                         static_cast<int>(nx), static_cast<int>(ny),
                                                         static_cast<int>(along_x));
  return factor;
}

template void cell_smoother(const Queue&, const Array<float>&, std::size_t, std::size_t, Array<int>&,
                            Array<float>&, int, int);
template void cell_smoother(const Queue&, const Array<double>&, std::size_t, std::size_t, Array<int>&,
                            Array<float>&, int, int);
template void cell_smoother(const Queue&, const Array<double>&, std::size_t, std::size_t, Array<int>&,
                            Array<double>&, int, int);
template Array<float> line_factor(const Queue&, const Array<float>&, std::size_t, std::size_t, bool,
                                  Array<int>&);
template Array<double> line_factor(const Queue&, const Array<double>&, std::size_t, std::size_t, bool,
                                   Array<int>&);

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
