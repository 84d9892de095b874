#include "service/tissue/solid/solid_tissue.h"

#include <fmt/format.h>

#include <algorithm>
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

}  // namespace teletact::service
