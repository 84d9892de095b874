#include "service/solid/solid_tissue.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
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
  const std::size_t columns = tissue.grid.columns();
  LayeredTissue out;
  for (std::size_t j = 0; j < tissue.grid.layers(); ++j) {
    const auto begin = tissue.youngs_modulus_pa.begin() + static_cast<std::ptrdiff_t>(j * columns);
    const auto end = begin + static_cast<std::ptrdiff_t>(columns);
    const auto [low, high] = std::minmax_element(begin, end);
    double sum = 0;
    for (auto e = begin; e != end; ++e) sum += std::log(*e / *low);
    const double mean = *low == *high ? *low : *low * std::exp(sum / static_cast<double>(columns));
    out.youngs_modulus_pa.push_back(mean);
    out.least = std::min(out.least, *low / mean);
    out.largest = std::max(out.largest, *high / mean);
  }
  return out;
}

}  // namespace teletact::service
