#include "tests/reference/strain.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace teletact::reference {

StrainTensor least_squares_strain(const DisplacementField& f, int i, int j, int half_columns, int half_rows,
                                  double min_fraction) {
  std::vector<Eigen::Vector3d> rows;
  std::vector<Eigen::Vector2d> values;
  int inside = 0;
  for (int r = std::max(j - half_rows, 0); r <= std::min(j + half_rows, f.ny - 1); ++r)
    for (int c = std::max(i - half_columns, 0); c <= std::min(i + half_columns, f.nx - 1); ++c) {
      ++inside;
      const auto node = static_cast<std::size_t>(c + f.nx * r);
      if (!f.trusted[node]) continue;
      rows.emplace_back(1, (c - i) * f.dx_m, (r - j) * f.dy_m);
      values.emplace_back(f.lateral[node], f.axial[node]);
    }
  const auto count = static_cast<Eigen::Index>(rows.size());
  if (count < 4 || static_cast<double>(count) < min_fraction * inside) return {};
  Eigen::MatrixXd plane(count, 3), u(count, 2);
  for (Eigen::Index n = 0; n < count; ++n) {
    plane.row(n) = rows[static_cast<std::size_t>(n)].transpose();
    u.row(n) = values[static_cast<std::size_t>(n)].transpose();
  }
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> factor(plane);
  if (factor.rank() < 3) return {};
  const Eigen::MatrixXd slopes = factor.solve(u);
  const double residual = (plane * slopes.col(1) - u.col(1)).norm() / std::sqrt(static_cast<double>(count));
  return {true, slopes(1, 0), slopes(2, 1), 0.5 * (slopes(2, 0) + slopes(1, 1)), residual};
}

}  // namespace teletact::reference
