#include "tests/reference/adjoint_weighted.h"

#include <Eigen/SparseCore>
#include <Eigen/SparseLU>
#include <array>
#include <cmath>

namespace teletact::reference {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;

}  // namespace

AdjointWeightedSolution solve(const AdjointWeighted& p) {
  const std::size_t count = p.nx * p.ny, kinds = p.with_pressure ? 2 : 1;  // mu first, then p / 2
  const auto border = [&](std::size_t n) {
    return n % p.nx == 0 || n % p.nx == p.nx - 1 || n / p.nx == 0 || n / p.nx == p.ny - 1;
  };
  const auto tensor = [&](std::size_t n) {
    Matrix2d t;
    t << p.xx[n], p.xy[n], p.xy[n], p.yy[n];
    return t;
  };
  std::vector<Eigen::Triplet<double>> entries;
  const auto unknowns = static_cast<Eigen::Index>(kinds * count);
  Eigen::VectorXd right = Eigen::VectorXd::Zero(unknowns);
  for (std::size_t n = 0; n < count; ++n) {
    if (!border(n)) continue;
    for (std::size_t c = 0; c < kinds; ++c) {
      const auto row = static_cast<int>(n + c * count);
      entries.emplace_back(row, row, 1.0);
      right[row] = c == 0 ? p.mu[n] : p.half_pressure[n];
    }
  }
  const double gauss[] = {0.5 - 0.5 / std::sqrt(3.0), 0.5 + 0.5 / std::sqrt(3.0)};
  for (std::size_t j = 0; j + 1 < p.ny; ++j)
    for (std::size_t i = 0; i + 1 < p.nx; ++i) {
      const std::array<std::size_t, 4> at{i + p.nx * j, i + 1 + p.nx * j, i + p.nx * (j + 1),
                                          i + 1 + p.nx * (j + 1)};
      for (const double s : gauss)
        for (const double t : gauss) {
          const double n[] = {(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t};
          const Vector2d slope[] = {{-(1 - t) / p.dx, -(1 - s) / p.dy},
                                    {(1 - t) / p.dx, -s / p.dy},
                                    {-t / p.dx, (1 - s) / p.dy},
                                    {t / p.dx, s / p.dy}};
          Matrix2d here = Matrix2d::Zero();
          for (std::size_t a = 0; a < 4; ++a) here += n[a] * tensor(at[a]);
          const double area = p.dx * p.dy / 4;
          for (std::size_t a = 0; a < 4; ++a) {
            if (border(at[a])) continue;
            for (std::size_t b = 0; b < 4; ++b) {
              const Vector2d test[] = {here * slope[a], -slope[a]};
              const Vector2d trial[] = {tensor(at[b]) * slope[b], -slope[b]};
              for (std::size_t c = 0; c < kinds; ++c)
                for (std::size_t d = 0; d < kinds; ++d) {
                  double value = test[c].dot(trial[d]);
                  if (c == 0 && d == 0) value += p.stabilisation * p.scale * p.scale * slope[a].dot(slope[b]);
                  entries.emplace_back(static_cast<int>(at[a] + c * count),
                                       static_cast<int>(at[b] + d * count), area * value);
                }
            }
          }
        }
    }
  Eigen::SparseMatrix<double> matrix(unknowns, unknowns);
  matrix.setFromTriplets(entries.begin(), entries.end());
  const Eigen::SparseLU<Eigen::SparseMatrix<double>> lu(matrix);
  const Eigen::VectorXd x = lu.solve(right);
  AdjointWeightedSolution out;
  out.mu.assign(x.data(), x.data() + count);
  if (p.with_pressure) out.half_pressure.assign(x.data() + count, x.data() + 2 * count);
  return out;
}

}  // namespace teletact::reference
