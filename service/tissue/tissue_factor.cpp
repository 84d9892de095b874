#include "service/tissue/tissue_factor.h"

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "service/tissue/element.h"

namespace teletact::service {
namespace {

using Eigen::Index;

// Lower triangle of K, held unknowns as the identity.
Eigen::SparseMatrix<double> assemble(const TissueGrid& grid, const Material& material,
                                     const std::vector<std::uint8_t>& free) {
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(36 * grid.elements() + grid.dofs());
  for (std::size_t j = 0; j + 1 < grid.ny(); ++j)
    for (std::size_t i = 0; i + 1 < grid.nx(); ++i) {
      const auto k =
          element_stiffness(grid.x_m[i + 1] - grid.x_m[i], grid.y_m[j + 1] - grid.y_m[j],
                            material.youngs_modulus_pa[grid.element(i, j)], material.poisson_ratio);
      const std::array nodes{grid.node(i, j), grid.node(i + 1, j), grid.node(i, j + 1),
                             grid.node(i + 1, j + 1)};
      for (std::size_t a = 0; a < 8; ++a)
        for (std::size_t b = 0; b < 8; ++b) {
          const std::size_t row = 2 * nodes[a / 2] + a % 2, column = 2 * nodes[b / 2] + b % 2;
          if (row >= column && free[row] && free[column])
            entries.emplace_back(row, column, k(static_cast<Index>(a), static_cast<Index>(b)));
        }
    }
  for (std::size_t n = 0; n < free.size(); ++n)
    if (!free[n]) entries.emplace_back(n, n, 1.0);
  Eigen::SparseMatrix<double> k(static_cast<Index>(grid.dofs()), static_cast<Index>(grid.dofs()));
  k.setFromTriplets(entries.begin(), entries.end());
  return k;
}

}  // namespace

struct TissueFactor::Factor {
  Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> ldlt;
};

TissueFactor::TissueFactor(const TissueGrid& grid, const Material& material,
                           const std::vector<std::uint8_t>& free)
    : material_(material), free_(free), factor_(std::make_unique<Factor>()) {
  validate(grid, material);
  if (free.size() != grid.dofs())
    throw std::invalid_argument("free must have one entry per degree of freedom (" +
                                std::to_string(grid.dofs()) + ")");
  factor_->ldlt.compute(assemble(grid, material, free));
  if (factor_->ldlt.info() != Eigen::Success || !(factor_->ldlt.vectorD().minCoeff() > 0))
    throw std::domain_error(
        "tissue factor: the stiffness is not positive definite; check the supports and reduce the modulus "
        "contrast");
}

TissueFactor::~TissueFactor() = default;

void TissueFactor::solve(std::span<const double> r, std::span<double> z) const {
  const auto size = static_cast<Index>(free_.size());
  Eigen::Map<Eigen::VectorXd>(z.data(), size) =
      factor_->ldlt.solve(Eigen::Map<const Eigen::VectorXd>(r.data(), size));
  for (std::size_t n = 0; n < free_.size(); ++n)
    if (!free_[n]) z[n] = 0;
}

double TissueFactor::condition(const Material& material) const {
  const std::vector<double>&old = material_.youngs_modulus_pa, &now = material.youngs_modulus_pa;
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  if (now.size() != old.size() || material.poisson_ratio != material_.poisson_ratio) return kInfinite;
  double least = kInfinite, greatest = 0;
  for (std::size_t e = 0; e < now.size(); ++e) {
    least = std::min(least, now[e] / old[e]);
    greatest = std::max(greatest, now[e] / old[e]);
  }
  return greatest / least;
}

std::size_t most_iterations(double condition, double reduction) {
  const double root = std::sqrt(condition), factor = (root - 1) / (root + 1);
  return factor == 0 ? 1 : static_cast<std::size_t>(std::ceil(std::log(reduction / 2) / std::log(factor)));
}

}  // namespace teletact::service
