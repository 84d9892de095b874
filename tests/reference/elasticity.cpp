#include "tests/reference/elasticity.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace teletact::reference {
namespace {

template <class T>
using Vector2 = Eigen::Matrix<T, 2, 1>;

// Values and gradients of the four shape functions at (s, t) in [0, 1]^2 of a width x height rectangle.
template <class T>
struct Shape {
  std::array<T, 4> n;
  std::array<Vector2<T>, 4> gradient;
};

template <class T>
Shape<T> shape_at(T s, T t, T width, T height) {
  return {{(1 - s) * (1 - t), s * (1 - t), (1 - s) * t, s * t},
          {Vector2<T>(-(1 - t) / width, -(1 - s) / height), Vector2<T>((1 - t) / width, -s / height),
           Vector2<T>(-t / width, (1 - s) / height), Vector2<T>(t / width, s / height)}};
}

// Strain [eps_xx, eps_yy, gamma_xy] from the eight nodal displacements.
template <class T>
Eigen::Matrix<T, 3, 8> strain_matrix(const Shape<T>& shape) {
  Eigen::Matrix<T, 3, 8> b = Eigen::Matrix<T, 3, 8>::Zero();
  for (int a = 0; a < 4; ++a) {
    b(0, 2 * a) = shape.gradient[a].x();
    b(1, 2 * a + 1) = shape.gradient[a].y();
    b(2, 2 * a) = shape.gradient[a].y();
    b(2, 2 * a + 1) = shape.gradient[a].x();
  }
  return b;
}

std::array<std::size_t, 4> element_nodes(const service::TissueGrid& grid, std::size_t i, std::size_t j) {
  return {grid.node(i, j), grid.node(i + 1, j), grid.node(i, j + 1), grid.node(i + 1, j + 1)};
}

}  // namespace

template <class T>
Eigen::Matrix<T, 8, 8> element_matrix(T width_m, T height_m, T youngs_modulus_pa, T poisson_ratio,
                                      Integration integration) {
  const T mu = youngs_modulus_pa / (2 * (1 + poisson_ratio));
  const T lambda = youngs_modulus_pa * poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio));
  const Eigen::Matrix<T, 3, 3> shear = Eigen::Matrix<T, 3, 1>(2 * mu, 2 * mu, mu).asDiagonal();
  const Eigen::Matrix<T, 3, 1> trace(1, 1, 0);
  const T area = width_m * height_m, half = T(1) / 2, offset = std::sqrt(T(1) / 12);
  Eigen::Matrix<T, 8, 8> k = Eigen::Matrix<T, 8, 8>::Zero();
  for (const T s : {half - offset, half + offset})
    for (const T t : {half - offset, half + offset}) {
      const auto b = strain_matrix(shape_at(s, t, width_m, height_m));
      k += area / 4 * b.transpose() * shear * b;
      if (integration == Integration::kFull)
        k += area / 4 * lambda * (b.transpose() * trace) * (trace.transpose() * b);
    }
  if (integration == Integration::kSelectiveReduced) {
    const auto b = strain_matrix(shape_at(half, half, width_m, height_m));
    k += area * lambda * (b.transpose() * trace) * (trace.transpose() * b);
  }
  return k;
}

template <class T>
Eigen::SparseMatrix<T> assemble(const service::TissueGrid& grid, const service::Material& material,
                                Integration integration) {
  std::vector<Eigen::Triplet<T>> entries;
  entries.reserve(64 * grid.elements());
  for (std::size_t j = 0; j + 1 < grid.ny(); ++j)
    for (std::size_t i = 0; i + 1 < grid.nx(); ++i) {
      const Eigen::Matrix<T, 8, 8> k = element_matrix<T>(
          T(grid.x_m[i + 1]) - T(grid.x_m[i]), T(grid.y_m[j + 1]) - T(grid.y_m[j]),
          material.youngs_modulus_pa[grid.element(i, j)], material.poisson_ratio, integration);
      const auto nodes = element_nodes(grid, i, j);
      for (int a = 0; a < 8; ++a)
        for (int b = 0; b < 8; ++b)
          entries.emplace_back(2 * nodes[a / 2] + a % 2, 2 * nodes[b / 2] + b % 2, k(a, b));
    }
  Eigen::SparseMatrix<T> k(Eigen::Index(grid.dofs()), Eigen::Index(grid.dofs()));
  k.setFromTriplets(entries.begin(), entries.end());
  return k;
}

template Eigen::Matrix<double, 8, 8> element_matrix(double, double, double, double, Integration);
template Eigen::SparseMatrix<double> assemble(const service::TissueGrid&, const service::Material&,
                                              Integration);
template Eigen::SparseMatrix<long double> assemble(const service::TissueGrid&, const service::Material&,
                                                   Integration);

std::vector<std::size_t> fixed_dofs(const service::TissueGrid& grid, const service::Supports& supports) {
  using service::EdgeSupport;
  std::vector<std::size_t> fixed;
  for (std::size_t j = 0; j < grid.ny(); ++j) {
    for (std::size_t i = 0; i < grid.nx(); ++i) {
      const bool held = (j == 0 && supports.top == EdgeSupport::kFixed) ||
                        (j + 1 == grid.ny() && supports.bottom == EdgeSupport::kFixed) ||
                        (i == 0 && supports.left == EdgeSupport::kFixed) ||
                        (i + 1 == grid.nx() && supports.right == EdgeSupport::kFixed);
      if (held) fixed.insert(fixed.end(), {2 * grid.node(i, j), 2 * grid.node(i, j) + 1});
    }
  }
  return fixed;
}

Eigen::SparseMatrix<double> with_fixed(const Eigen::SparseMatrix<double>& k,
                                       const std::vector<std::size_t>& fixed) {
  std::vector<bool> held(std::size_t(k.rows()), false);
  for (std::size_t dof : fixed) held[dof] = true;
  Eigen::SparseMatrix<double> result = k;
  result.prune([&](Eigen::Index row, Eigen::Index column, double) {
    return row == column || (!held[std::size_t(row)] && !held[std::size_t(column)]);
  });
  return result;
}

Eigen::VectorXd body_load(const service::TissueGrid& grid,
                          const std::function<Eigen::Vector2d(double x_m, double y_m)>& force) {
  const double offset = std::sqrt(0.6) / 2;
  const std::array<double, 3> points{0.5 - offset, 0.5, 0.5 + offset}, weights{5.0 / 18, 8.0 / 18, 5.0 / 18};
  Eigen::VectorXd load = Eigen::VectorXd::Zero(Eigen::Index(grid.dofs()));
  for (std::size_t j = 0; j + 1 < grid.ny(); ++j) {
    for (std::size_t i = 0; i + 1 < grid.nx(); ++i) {
      const double width = grid.x_m[i + 1] - grid.x_m[i], height = grid.y_m[j + 1] - grid.y_m[j];
      const auto nodes = element_nodes(grid, i, j);
      for (int p = 0; p < 3; ++p) {
        for (int q = 0; q < 3; ++q) {
          const Shape<double> shape = shape_at(points[p], points[q], width, height);
          const Eigen::Vector2d b = force(grid.x_m[i] + points[p] * width, grid.y_m[j] + points[q] * height);
          for (int a = 0; a < 4; ++a) {
            load.segment<2>(Eigen::Index(2 * nodes[a])) +=
                weights[p] * weights[q] * width * height * shape.n[a] * b;
          }
        }
      }
    }
  }
  return load;
}

}  // namespace teletact::reference
