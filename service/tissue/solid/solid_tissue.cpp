#include "service/tissue/solid/solid_tissue.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <span>
#include <stdexcept>

namespace teletact::service {

namespace {

void require_size(std::size_t n, const char* field) {
  if (!std::has_single_bit(n) || n > 512)
    throw std::invalid_argument(fmt::format("{} is {}; give a power of two up to 512", field, n));
}

void require_length(double value, const char* field) {
  if (!(value > 0) || !std::isfinite(value))
    throw std::invalid_argument(fmt::format("{} is {}; give a finite length above 0 m", field, value));
}

std::span<const double> elements_of(const SolidTissue& tissue, std::size_t layer) {
  const std::size_t columns = tissue.grid.columns();
  return {tissue.youngs_modulus_pa.data() + layer * columns, columns};
}

}  // namespace

void validate(const SolidTissue& tissue) {
  const SolidGrid& grid = tissue.grid;
  require_size(grid.nx, "nx");
  if (grid.nx < 2) throw std::invalid_argument("nx is 1; give at least 2");
  require_size(grid.nz, "nz");
  require_length(grid.spacing_x_m, "spacing_x_m");
  require_length(grid.spacing_z_m, "spacing_z_m");
  if (grid.y_m.size() < 2) throw std::invalid_argument("y_m has fewer than 2 rows of nodes; give at least 2");
  if (grid.slides && grid.layers() < 2) throw std::invalid_argument("y_m has no layer above the rollers");
  for (std::size_t j = 0; j + 1 < grid.y_m.size(); ++j)
    if (!(grid.y_m[j] < grid.y_m[j + 1]) || !std::isfinite(grid.y_m[j + 1] - grid.y_m[j]))
      throw std::invalid_argument(
          fmt::format("y_m[{}] is {} after {}; give increasing depths", j + 1, grid.y_m[j + 1], grid.y_m[j]));
  for (std::size_t j = 0; j + 1 < grid.y_m.size(); ++j)  // thinner ones are lost to rounding
    if (grid.y_m[j + 1] - grid.y_m[j] < 1e-6 * (grid.y_m.back() - grid.y_m.front()))
      throw std::invalid_argument(
          fmt::format("y_m[{}]: the layer above it is thinner than a millionth of the depth", j + 1));
  if (!(tissue.poisson_ratio >= 0 && tissue.poisson_ratio < 0.5))
    throw std::invalid_argument(
        fmt::format("poisson_ratio is {}; give 0 or more, below 0.5", tissue.poisson_ratio));
  if (tissue.youngs_modulus_pa.size() != grid.elements())
    throw std::invalid_argument(fmt::format("youngs_modulus_pa has {} values for {} elements",
                                            tissue.youngs_modulus_pa.size(), grid.elements()));
  for (std::size_t e = 0; e < grid.elements(); ++e)
    if (const double modulus = tissue.youngs_modulus_pa[e]; !(modulus > 0) || !std::isfinite(modulus))
      throw std::invalid_argument(
          fmt::format("youngs_modulus_pa[{}] is {}; give a finite value above 0 Pa", e, modulus));
}

LayeredTissue layered(const SolidTissue& tissue) {
  std::vector<double> means;
  for (std::size_t j = 0; j < tissue.grid.layers(); ++j) {
    const auto layer = elements_of(tissue, j);
    const auto [low, high] = std::minmax_element(layer.begin(), layer.end());
    double sum = 0;
    for (const double e : layer) sum += std::log(e / *low);
    means.push_back(*low == *high ? *low : *low * std::exp(sum / static_cast<double>(layer.size())));
  }
  return beside(tissue, means);
}

SolidTissue solid_of(const SolidGrid& grid, const LayeredTissue& layers, double poisson_ratio) {
  SolidTissue out{grid, {}, poisson_ratio};
  for (const double e : layers.youngs_modulus_pa)
    out.youngs_modulus_pa.insert(out.youngs_modulus_pa.end(), grid.columns(), e);
  return out;
}

LayeredTissue beside(const SolidTissue& tissue, const std::vector<double>& layers_pa) {
  if (layers_pa.size() != tissue.grid.layers())
    throw std::invalid_argument(
        fmt::format("layers_pa has {} values for {} layers", layers_pa.size(), tissue.grid.layers()));
  LayeredTissue out{layers_pa};
  for (std::size_t j = 0; j < layers_pa.size(); ++j) {
    const auto layer = elements_of(tissue, j);
    const auto [low, high] = std::minmax_element(layer.begin(), layer.end());
    out.least = std::min(out.least, *low / layers_pa[j]);
    out.largest = std::max(out.largest, *high / layers_pa[j]);
  }
  return out;
}

namespace {

// Integrals over one side of length h of products of its two linear shape functions or their slopes.
double integral(double h, int a, int b, bool slope_of_a, bool slope_of_b) {
  const double sign_a = a ? 1 : -1, sign_b = b ? 1 : -1;
  if (slope_of_a && slope_of_b) return sign_a * sign_b / h;
  if (slope_of_a) return sign_a / 2;
  if (slope_of_b) return sign_b / 2;
  return a == b ? h / 3 : h / 6;
}

}  // namespace

HexahedronMatrix hexahedron_stiffness(double size_x_m, double size_y_m, double size_z_m,
                                      double poisson_ratio) {
  const std::array<double, 3> size{size_x_m, size_y_m, size_z_m};
  const double volume = size[0] * size[1] * size[2];
  const double mu = 1 / (2 * (1 + poisson_ratio));
  const double lambda = 2 * mu * poisson_ratio / (1 - 2 * poisson_ratio);
  const auto corner = [](int n) { return std::array<int, 3>{n & 1, n >> 2, (n >> 1) & 1}; };  // x, y, z
  HexahedronMatrix k;
  for (int m = 0; m < 8; ++m) {
    for (int n = 0; n < 8; ++n) {
      const auto a = corner(m), b = corner(n);
      // Int dN_m/dp dN_n/dq
      const auto product = [&](int p, int q) {
        double value = 1;
        for (int s = 0; s < 3; ++s)
          value *= integral(size[static_cast<std::size_t>(s)], a[static_cast<std::size_t>(s)],
                            b[static_cast<std::size_t>(s)], s == p, s == q);
        return value;
      };
      // 2 mu eps(v):eps(u) = mu (dv_p/dq du_p/dq + dv_p/dq du_q/dp)
      const double gradients = product(0, 0) + product(1, 1) + product(2, 2);
      for (int p = 0; p < 3; ++p)
        for (int q = 0; q < 3; ++q) k(3 * m + p, 3 * n + q) = mu * (product(q, p) + (p == q ? gradients : 0));
    }
  }
  Eigen::Matrix<double, 24, 1> divergence;
  for (int m = 0; m < 8; ++m)
    for (int p = 0; p < 3; ++p) {
      const auto s = static_cast<std::size_t>(p);
      divergence[3 * m + p] = (corner(m)[s] ? 1 : -1) / (4 * size[s]);
    }
  k += lambda * volume * divergence * divergence.transpose();
  return k;
}

HexahedronMatrix layer_stiffness(const SolidGrid& grid, std::size_t layer, double poisson_ratio) {
  const double height_m = grid.y_m[layer + 1] - grid.y_m[layer];
  if (!grid.slides || layer + 1 < grid.layers())
    return hexahedron_stiffness(grid.spacing_x_m, height_m, grid.spacing_z_m, poisson_ratio);
  constexpr std::array kSprings{1e-3, 100.0, 1e-3};
  HexahedronMatrix k = HexahedronMatrix::Zero();
  for (int m = 0; m < 8; ++m)
    for (int n = 0; n < 8; ++n) {
      const double spring = integral(grid.spacing_x_m, m & 1, n & 1, false, false) *
                            integral(height_m, m >> 2, n >> 2, true, true) *
                            integral(grid.spacing_z_m, m >> 1 & 1, n >> 1 & 1, false, false);
      for (int p = 0; p < 3; ++p) k(3 * m + p, 3 * n + p) = kSprings[static_cast<std::size_t>(p)] * spring;
    }
  return k;
}

std::array<double, 72> parity_blocks(const HexahedronMatrix& k) {
  // Of corner n, in a sum of parity s.
  const auto sign = [](int s, int n) {
    const int x = n & 1, y = n >> 2, z = (n >> 1) & 1;
    return std::popcount(static_cast<unsigned>(s & ~(x | y << 1 | z << 2))) % 2 ? -1.0 : 1.0;
  };
  std::array<double, 72> blocks{};
  auto to = blocks.begin();
  for (int s = 0; s < 8; ++s)
    for (int p = 0; p < 3; ++p)
      for (int q = 0; q < 3; ++q, ++to)
        for (int m = 0; m < 8; ++m)
          for (int n = 0; n < 8; ++n)
            *to += sign(s ^ 1 << p, m) * k(3 * m + p, 3 * n + q) * sign(s ^ 1 << q, n) / 64;
  return blocks;
}

}  // namespace teletact::service
