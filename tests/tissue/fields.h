// Displacement fields with known answers.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <functional>
#include <numbers>

#include "service/tissue/grid.h"

namespace teletact::tests {

// [dof of the grid]
inline Eigen::VectorXd nodal(const service::TissueGrid& grid,
                             const std::function<Eigen::Vector2d(double, double)>& field) {
  Eigen::VectorXd u(Eigen::Index(grid.dofs()));
  for (std::size_t j = 0; j < grid.ny(); ++j) {
    for (std::size_t i = 0; i < grid.nx(); ++i) {
      u.segment<2>(Eigen::Index(2 * grid.node(i, j))) = field(grid.x_m[i], grid.y_m[j]);
    }
  }
  return u;
}

// u = 1 mm sin(pi x / L) sin(pi y / L) (1, -1/2), zero on all edges, and the body force that it needs.
struct Manufactured {
  Manufactured(double youngs_modulus_pa, double poisson_ratio)
      : mu(youngs_modulus_pa / (2 * (1 + poisson_ratio))),
        lambda(2 * mu * poisson_ratio / (1 - 2 * poisson_ratio)) {}
  double length = 0.04, mu, lambda;
  Eigen::Vector2d displacement(double x, double y) const {
    const double s = std::sin(std::numbers::pi * x / length) * std::sin(std::numbers::pi * y / length);
    return 1e-3 * Eigen::Vector2d(s, -0.5 * s);
  }
  // -div sigma = -(mu lap u + (lambda + mu) grad div u)
  Eigen::Vector2d force(double x, double y) const {
    const double q = std::numbers::pi / length;
    const double ss = std::sin(q * x) * std::sin(q * y), cc = std::cos(q * x) * std::cos(q * y);
    const double a = 1e-3, b = -0.5e-3;
    const double div_x = q * q * (-a * ss + b * cc), div_y = q * q * (a * cc - b * ss);
    return {2 * mu * q * q * a * ss - (lambda + mu) * div_x, 2 * mu * q * q * b * ss - (lambda + mu) * div_y};
  }
};

}  // namespace teletact::tests
