#include "tests/reference/modulus_objective.h"

#include <Eigen/QR>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>

#include "tests/reference/elasticity.h"

namespace teletact::reference {

using Eigen::Index;
using Eigen::VectorXd;

VectorXd ModulusObjective::displacement(const VectorXd& log_modulus) const {
  // Plane strain has lambda = E nu / (1 + nu)(1 - 2 nu), plane stress E nu / (1 - nu^2), both mu = E / 2(1 +
  // nu): the plane-strain solid with the same two.
  const double mu = 1 / (2 * (1 + poisson_ratio));
  const double lambda = plane_stress ? poisson_ratio / (1 - poisson_ratio * poisson_ratio)
                                     : poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio));
  service::Material material;
  material.poisson_ratio = lambda / (2 * (lambda + mu));
  const double per_e = mu * (3 * lambda + 2 * mu) / (lambda + mu);
  for (Index e = 0; e < log_modulus.size(); ++e)
    material.youngs_modulus_pa.push_back(per_e * background_pa * std::exp(log_modulus[e]));
  const Eigen::SparseMatrix<double> k = assemble(grid, material);
  std::vector<std::size_t> held;
  VectorXd push = VectorXd::Zero(k.rows());
  for (std::size_t i = 0; i < grid.nx(); ++i) {
    const std::size_t bottom = grid.node(i, grid.ny() - 1);
    held.insert(held.end(), {2 * bottom, 2 * bottom + 1});
    if (i < first_column || i > last_column) continue;
    held.push_back(2 * grid.node(i, 0) + 1);
    push[static_cast<Index>(2 * grid.node(i, 0) + 1)] = 1;
  }
  VectorXd load = -(k * push);
  for (const std::size_t d : held) load[static_cast<Index>(d)] = 0;
  std::sort(held.begin(), held.end());
  return push + Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>>(with_fixed(k, held)).solve(load);
}

double ModulusObjective::variation(const VectorXd& v) const {
  const std::size_t nx = grid.nx() - 1, ny = grid.ny() - 1;
  const auto centre = [](const std::vector<double>& c, std::size_t k) { return 0.5 * (c[k] + c[k + 1]); };
  double sum = 0;
  for (std::size_t j = 0; j < ny; ++j)
    for (std::size_t i = 0; i < nx; ++i) {
      const auto at = [&](std::size_t a, std::size_t b) { return v[static_cast<Index>(a + nx * b)]; };
      double right = 0, below = 0;
      if (i + 1 < nx) right = (at(i + 1, j) - at(i, j)) / (centre(grid.x_m, i + 1) - centre(grid.x_m, i));
      if (j + 1 < ny) below = (at(i, j + 1) - at(i, j)) / (centre(grid.y_m, j + 1) - centre(grid.y_m, j));
      const double area = (grid.x_m[i + 1] - grid.x_m[i]) * (grid.y_m[j + 1] - grid.y_m[j]);
      sum += area *
             (std::sqrt(right * right + below * below + tv_floor_per_m * tv_floor_per_m) - tv_floor_per_m);
    }
  return sum;
}

double ModulusObjective::value(const VectorXd& log_modulus) const {
  const VectorXd u = displacement(log_modulus);
  // Rows (modelled, 1) / deviation, least squares for amplitude and offset.
  Eigen::MatrixXd line(static_cast<Index>(data.size()), 2);
  VectorXd measured(static_cast<Index>(data.size()));
  for (std::size_t k = 0; k < data.size(); ++k) {
    const AxialDatum& d = data[k];
    std::size_t i = 0, j = 0;
    while (i + 2 < grid.nx() && grid.x_m[i + 1] <= d.x_m) ++i;
    while (j + 2 < grid.ny() && grid.y_m[j + 1] <= d.y_m) ++j;
    const double s = (d.x_m - grid.x_m[i]) / (grid.x_m[i + 1] - grid.x_m[i]),
                 t = (d.y_m - grid.y_m[j]) / (grid.y_m[j + 1] - grid.y_m[j]);
    const auto axial = [&](std::size_t a, std::size_t b) {
      return u[static_cast<Index>(2 * grid.node(i + a, j + b) + 1)];
    };
    const double modelled =
        (1 - t) * ((1 - s) * axial(0, 0) + s * axial(1, 0)) + t * ((1 - s) * axial(0, 1) + s * axial(1, 1));
    line.row(static_cast<Index>(k)) << modelled / d.deviation_m, 1 / d.deviation_m;
    measured[static_cast<Index>(k)] = d.displacement_m / d.deviation_m;
  }
  const VectorXd fit = line.colPivHouseholderQr().solve(measured);
  const VectorXd off = log_modulus - prior;
  return 0.5 * independence * (line * fit - measured).squaredNorm() + tv * variation(log_modulus) +
         0.5 * off.dot(prior_weight.cwiseProduct(off));
}

}  // namespace teletact::reference
