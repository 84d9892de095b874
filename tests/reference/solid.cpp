#include "tests/reference/solid.h"

#include <array>
#include <cmath>
#include <stdexcept>

namespace teletact::reference {
namespace {

using Hexahedron = Eigen::Matrix<double, 24, 24>;

// Strain [xx, yy, zz, yz, xz, xy], shear as gamma, of the 24 displacements at a point in [0, 1]^3. Corners
// a_x + 2 a_z + 4 a_y.
Eigen::Matrix<double, 6, 24> strain_matrix(const Eigen::Vector3d& at, const Eigen::Vector3d& size) {
  Eigen::Matrix<double, 6, 24> b = Eigen::Matrix<double, 6, 24>::Zero();
  for (int n = 0; n < 8; ++n) {
    const std::array<int, 3> corner{n & 1, n >> 2, (n >> 1) & 1};
    Eigen::Vector3d gradient;
    for (int p = 0; p < 3; ++p) {
      gradient[p] = 1;
      for (int s = 0; s < 3; ++s) {
        const double t = at[s];
        const bool far = corner[static_cast<std::size_t>(s)];
        gradient[p] *= s == p ? (far ? 1 : -1) / size[s] : (far ? t : 1 - t);
      }
    }
    const int u = 3 * n;
    b(0, u) = gradient[0];
    b(1, u + 1) = gradient[1];
    b(2, u + 2) = gradient[2];
    b(3, u + 1) = gradient[2];
    b(3, u + 2) = gradient[1];
    b(4, u) = gradient[2];
    b(4, u + 2) = gradient[0];
    b(5, u) = gradient[1];
    b(5, u + 1) = gradient[0];
  }
  return b;
}

Hexahedron element_matrix(const Eigen::Vector3d& size, double nu, bool rollers) {
  const double mu = 1 / (2 * (1 + nu)), lambda = nu / ((1 + nu) * (1 - 2 * nu)), volume = size.prod();
  Eigen::Matrix<double, 6, 1> shear;
  shear << 2 * mu, 2 * mu, 2 * mu, mu, mu, mu;
  Eigen::Matrix<double, 6, 1> trace;
  trace << 1, 1, 1, 0, 0, 0;
  Hexahedron k = Hexahedron::Zero();
  const double points[2] = {0.5 - std::sqrt(1.0 / 12), 0.5 + std::sqrt(1.0 / 12)};
  for (double r : points)
    for (double s : points)
      for (double t : points) {
        const auto b = strain_matrix({r, s, t}, size);
        if (!rollers) {
          k += volume / 8 * b.transpose() * shear.asDiagonal() * b;
          continue;
        }
        for (int m = 0; m < 8; ++m)  // springs along y: 100 against u_y, 1e-3 against u_x and u_z
          for (int n = 0; n < 8; ++n)
            for (int p = 0; p < 3; ++p)
              k(3 * m + p, 3 * n + p) +=
                  volume / 8 * (p == 1 ? 100 : 1e-3) * b(1, 3 * m + 1) * b(1, 3 * n + 1);
      }
  if (rollers) return k;
  const auto centre = strain_matrix({0.5, 0.5, 0.5}, size);
  k += volume * lambda * (centre.transpose() * trace) * (trace.transpose() * centre);
  return k;
}

}  // namespace

std::size_t unknown(const service::SolidGrid& grid, std::size_t i, std::size_t j, std::size_t k,
                    std::size_t c) {
  return i % grid.nx + grid.nx * (k % grid.nz + grid.nz * (3 * j + c));
}

Eigen::SparseMatrix<double> assemble(const service::SolidTissue& tissue) {
  const service::SolidGrid& grid = tissue.grid;
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(576 * grid.elements());
  for (std::size_t j = 0; j < grid.layers(); ++j) {
    const Eigen::Vector3d size(grid.spacing_x_m, grid.y_m[j + 1] - grid.y_m[j], grid.spacing_z_m);
    const Hexahedron unit = element_matrix(size, tissue.poisson_ratio, grid.slides && j + 1 == grid.layers());
    for (std::size_t k = 0; k < grid.nz; ++k)
      for (std::size_t i = 0; i < grid.nx; ++i) {
        const double modulus = tissue.youngs_modulus_pa[i + grid.nx * (k + grid.nz * j)];
        for (int m = 0; m < 24; ++m)
          for (int n = 0; n < 24; ++n) {
            const auto row = [&](int freedom) {
              const auto corner = static_cast<std::size_t>(freedom / 3);
              return std::array<std::size_t, 2>{
                  j + corner / 4, unknown(grid, i + corner % 2, j + corner / 4, k + corner / 2 % 2,
                                          static_cast<std::size_t>(freedom % 3))};
            };
            const auto a = row(m), b = row(n);
            if (a[0] == grid.layers() || b[0] == grid.layers()) continue;  // held
            entries.emplace_back(a[1], b[1], modulus * unit(m, n));
          }
      }
  }
  const auto size = static_cast<Eigen::Index>(grid.unknowns());
  Eigen::SparseMatrix<double> k(size, size);
  k.setFromTriplets(entries.begin(), entries.end());
  return k;
}

SolidReference::SolidReference(const service::SolidTissue& tissue) : k_(assemble(tissue)) {
  factor_.compute(k_);
  if (factor_.info() != Eigen::Success) throw std::runtime_error("the solid reference has no factor");
}

Eigen::VectorXd SolidReference::solve(const Eigen::VectorXd& load) const {
  Eigen::VectorXd u = factor_.solve(load);
  u += factor_.solve(load - k_ * u);
  return u;
}

Eigen::MatrixXd SolidReference::compliance(const std::vector<std::size_t>& unknowns) const {
  const auto n = static_cast<Eigen::Index>(unknowns.size());
  Eigen::MatrixXd s(n, n);
  for (Eigen::Index q = 0; q < n; ++q) {
    Eigen::VectorXd load = Eigen::VectorXd::Zero(k_.rows());
    load[static_cast<Eigen::Index>(unknowns[static_cast<std::size_t>(q)])] = 1;
    const Eigen::VectorXd u = solve(load);
    for (Eigen::Index p = 0; p < n; ++p)
      s(p, q) = u[static_cast<Eigen::Index>(unknowns[static_cast<std::size_t>(p)])];
  }
  return (s + s.transpose()) / 2;
}

}  // namespace teletact::reference
