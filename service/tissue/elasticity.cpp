#include "service/tissue/elasticity.h"

#include <algorithm>
#include <string>

#include "service/tissue/element.h"

namespace teletact::service {
namespace {

// Size of each interval times `length`, then the reciprocals.
template <class T>
std::vector<T> intervals(const std::vector<double>& coordinates, double length) {
  std::vector<T> out;
  for (std::size_t k = 0; k + 1 < coordinates.size(); ++k)
    out.push_back(static_cast<T>(length * (coordinates[k + 1] - coordinates[k])));
  for (std::size_t k = 0; k + 1 < coordinates.size(); ++k) out.push_back(1 / out[k]);
  return out;
}

// Of each element E over the reference, then mu / 3.
template <class T>
std::vector<T> moduli(const ScaledTissue& tissue, T mu_per_e) {
  std::vector<T> out;
  for (const double e : tissue.material.youngs_modulus_pa)
    out.push_back(static_cast<T>(e / tissue.reference_pa));
  for (std::size_t k = 0; k < tissue.material.youngs_modulus_pa.size(); ++k)
    out.push_back(mu_per_e * out[k] / 3);
  return out;
}

}  // namespace

LameRatios lame_ratios(double nu) {
  return {0.5 / (1 + nu), nu / ((1 + nu) * (1 - 2 * nu))};
}

std::vector<std::uint8_t> free_unknowns(const TissueGrid& grid, const Supports& supports) {
  std::vector<std::uint8_t> free(grid.dofs(), 1);
  for (std::size_t j = 0; j < grid.ny(); ++j)
    for (std::size_t i = 0; i < grid.nx(); ++i) {
      const bool fixed = (j == 0 && supports.top == EdgeSupport::kFixed) ||
                         (j + 1 == grid.ny() && supports.bottom == EdgeSupport::kFixed) ||
                         (i == 0 && supports.left == EdgeSupport::kFixed) ||
                         (i + 1 == grid.nx() && supports.right == EdgeSupport::kFixed);
      if (fixed) free[2 * grid.node(i, j)] = free[2 * grid.node(i, j) + 1] = 0;
    }
  return free;
}

void apply_on_host(const TissueGrid& grid, const Material& material, std::size_t count,
                   std::span<const double> x, std::span<double> y, double length) {
  using Vector8 = Eigen::Matrix<double, 8, 1>;
  std::fill(y.begin(), y.begin() + static_cast<std::ptrdiff_t>(count * grid.dofs()), 0.0);
  for (std::size_t j = 0; j + 1 < grid.ny(); ++j)
    for (std::size_t i = 0; i + 1 < grid.nx(); ++i) {
      const auto stiffness = element_stiffness(
          length * (grid.x_m[i + 1] - grid.x_m[i]), length * (grid.y_m[j + 1] - grid.y_m[j]),
          material.youngs_modulus_pa[grid.element(i, j)], material.poisson_ratio);
      // Its nodes lie in two pairs of neighbours: four consecutive unknowns each.
      const std::size_t top = 2 * grid.node(i, j), bottom = 2 * grid.node(i, j + 1);
      for (std::size_t q = 0; q < count; ++q) {
        const std::size_t base = q * grid.dofs();
        Vector8 u;
        u << Eigen::Map<const Eigen::Vector4d>(&x[base + top]),
            Eigen::Map<const Eigen::Vector4d>(&x[base + bottom]);
        const Vector8 force = stiffness * u;
        Eigen::Map<Eigen::Vector4d>(&y[base + top]) += force.head<4>();
        Eigen::Map<Eigen::Vector4d>(&y[base + bottom]) += force.tail<4>();
      }
    }
}

std::vector<double> stencil_on_host(const ScaledTissue& tissue) {
  const TissueGrid& grid = tissue.grid;
  std::vector<double> blocks(36 * grid.nodes());
  const auto add = [&](std::size_t node, std::size_t k, std::size_t entry, double value) {
    blocks[4 * (k * grid.nodes() + node) + entry] += value;
  };
  for (std::size_t j = 0; j + 1 < grid.ny(); ++j)
    for (std::size_t i = 0; i + 1 < grid.nx(); ++i) {
      const auto stiffness =
          element_stiffness(grid.x_m[i + 1] - grid.x_m[i], grid.y_m[j + 1] - grid.y_m[j],
                            tissue.material.youngs_modulus_pa[grid.element(i, j)] / tissue.reference_pa,
                            tissue.material.poisson_ratio);
      for (std::size_t row = 0; row < 8; ++row)
        for (std::size_t column = 0; column < 8; ++column) {
          const std::size_t a = row / 2, b = column / 2;  // corners: to the right in bit 0, below in bit 1
          const std::size_t node = grid.node(i + a % 2, j + a / 2), to = grid.node(i + b % 2, j + b / 2);
          if (tissue.free[2 * node + row % 2] && tissue.free[2 * to + column % 2])
            add(node, 3 * (1 + b / 2 - a / 2) + 1 + b % 2 - a % 2, 2 * (row % 2) + column % 2,
                stiffness(Eigen::Index(row), Eigen::Index(column)));
        }
    }
  for (std::size_t n = 0; n < grid.dofs(); ++n)
    if (!tissue.free[n]) add(n / 2, 4, 3 * (n % 2), 1);
  return blocks;
}

template <class T>
Elasticity<T>::Elasticity(const Queue& queue, const ScaledTissue& tissue, double length)
    : queue_(queue),
      nx_(tissue.grid.nx()),
      ny_(tissue.grid.ny()),
      mu_per_e_(static_cast<T>(lame_ratios(tissue.material.poisson_ratio).mu_per_e)),
      lambda_per_e_(static_cast<T>(lame_ratios(tissue.material.poisson_ratio).lambda_per_e)),
      modulus_(queue.array(moduli(tissue, mu_per_e_))),
      width_(queue.array(intervals<T>(tissue.grid.x_m, length))),
      height_(queue.array(intervals<T>(tissue.grid.y_m, length))),
      free_(queue.array(std::vector<T>(tissue.free.begin(), tissue.free.end()))),
      at_once_(queue.info().width<T>()),
      apply_(kernel("elasticity_apply")),
      stencil_(kernel("elasticity_stencil")) {}

template <class T>
Kernel Elasticity<T>::kernel(const char* name) const {
  return queue_.kernel("elasticity", name, precision_of<T>, {{"WIDTH", std::to_string(at_once_)}});
}

template <class T>
void Elasticity<T>::launch(const Array<T>& x, Array<T>& y, std::size_t count, int constrain) {
  Range range = grid_range((nx_ + at_once_ - 1) / at_once_, ny_, count);
  if (at_once_ > 1) range.local[0] = 1;
  apply_(range, x, y, modulus_, width_, height_, free_, mu_per_e_, lambda_per_e_, constrain,
         static_cast<int>(nx_), static_cast<int>(ny_));
}

template <class T>
void Elasticity<T>::apply(const Array<T>& x, Array<T>& y, std::size_t count) {
  launch(x, y, count, 1);
}

template <class T>
void Elasticity<T>::apply_unconstrained(const Array<T>& x, Array<T>& y, std::size_t count) {
  launch(x, y, count, 0);
}

template <class T>
Array<T> Elasticity<T>::stencil() {
  auto stencil = queue_.array<T>(36 * nx_ * ny_);
  stencil_(grid_range(nx_, ny_, 5), stencil, modulus_, width_, height_, free_, mu_per_e_, lambda_per_e_,
           static_cast<int>(nx_), static_cast<int>(ny_));
  return stencil;
}

template class Elasticity<float>;
template class Elasticity<double>;

}  // namespace teletact::service
