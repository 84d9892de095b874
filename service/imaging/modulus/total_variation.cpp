#include "service/imaging/modulus/total_variation.h"

#include <cmath>

#include "service/device/cancellation.h"

namespace teletact::service {
namespace {

std::vector<double> between_centres(const std::vector<double>& coordinates) {
  std::vector<double> out;
  for (std::size_t k = 0; k + 2 < coordinates.size(); ++k)
    out.push_back(0.5 * (coordinates[k + 2] - coordinates[k]));
  out.push_back(0);
  return out;
}

}  // namespace

TotalVariation::TotalVariation(const TissueGrid& grid)
    : grid_(grid),
      nx_(grid.nx() - 1),
      ny_(grid.ny() - 1),
      to_right_(between_centres(grid.x_m)),
      to_below_(between_centres(grid.y_m)) {}

double TotalVariation::area(std::size_t i, std::size_t j) const {
  return (grid_.x_m[i + 1] - grid_.x_m[i]) * (grid_.y_m[j + 1] - grid_.y_m[j]);
}

TotalVariation::Gradient TotalVariation::gradient(const Eigen::VectorXd& v, std::size_t i,
                                                  std::size_t j) const {
  const auto at = [&](std::size_t a, std::size_t b) { return v[static_cast<Eigen::Index>(a + nx_ * b)]; };
  Gradient g;
  if (i + 1 < nx_) g.right = (at(i + 1, j) - at(i, j)) / to_right_[i];
  if (j + 1 < ny_) g.below = (at(i, j + 1) - at(i, j)) / to_below_[j];
  g.size = std::sqrt(g.right * g.right + g.below * g.below + kTvFloorPerM * kTvFloorPerM);
  return g;
}

double TotalVariation::value(const Eigen::VectorXd& v, double edge_per_m) const {
  const auto cost = [&](double size) {
    return std::isfinite(edge_per_m) ? edge_per_m * std::log1p(size / edge_per_m) : size;
  };
  double sum = 0;
  for (std::size_t j = 0; j < ny_; ++j)
    for (std::size_t i = 0; i < nx_; ++i)
      sum += area(i, j) * (cost(gradient(v, i, j).size) - cost(kTvFloorPerM));
  return sum;
}

Eigen::SparseMatrix<double> TotalVariation::lagged(const Eigen::VectorXd& v, double edge_per_m) const {
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(8 * nx_ * ny_);
  const auto couple = [&](std::size_t a, std::size_t b, double weight) {
    const int p = static_cast<int>(a), q = static_cast<int>(b);
    entries.emplace_back(p, p, weight), entries.emplace_back(q, q, weight);
    entries.emplace_back(p, q, -weight), entries.emplace_back(q, p, -weight);
  };
  for (std::size_t j = 0; j < ny_; ++j) {
    check_cancelled();
    for (std::size_t i = 0; i < nx_; ++i) {
      const double size = gradient(v, i, j).size, weight = area(i, j) / (size * (1 + size / edge_per_m));
      const std::size_t e = i + nx_ * j;
      if (i + 1 < nx_) couple(e, e + 1, weight / (to_right_[i] * to_right_[i]));
      if (j + 1 < ny_) couple(e, e + nx_, weight / (to_below_[j] * to_below_[j]));
    }
  }
  const auto size = static_cast<Eigen::Index>(nx_ * ny_);
  Eigen::SparseMatrix<double> matrix(size, size);
  check_cancelled();
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

}  // namespace teletact::service
