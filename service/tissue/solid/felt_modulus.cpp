#include "service/tissue/solid/felt_modulus.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace teletact::service {
namespace {

// Of a round tip of 8 mm, 2 mm deep.
constexpr double kRadiusM = 0.004;
constexpr double kFineShare = 0.15;

}  // namespace

EnergyShares::Load EnergyShares::usual_load(const SolidGrid& grid) {
  std::vector<double> pressure;
  Load load;
  for (std::size_t node = 0; node < grid.columns(); ++node) {
    const auto away = [](std::size_t n, std::size_t period, double spacing_m) {
      return static_cast<double>(std::min(n, period - n)) * spacing_m;
    };
    const double r = std::hypot(away(node % grid.nx, grid.nx, grid.spacing_x_m),
                                away(node / grid.nx, grid.nz, grid.spacing_z_m));
    if (r >= kRadiusM) continue;
    load.unknowns.push_back(grid.columns() + node);
    pressure.push_back(std::sqrt(1 - r * r / (kRadiusM * kRadiusM)));
  }
  load.force_n =
      Eigen::Map<const Eigen::VectorXd>(pressure.data(), static_cast<Eigen::Index>(pressure.size()));
  return load;
}

EnergyShares::EnergyShares(const Queue& queue, const SolidGrid& grid, const LayeredTissue& tissue,
                           double poisson_ratio, const std::vector<double>& u)
    : columns_(grid.columns()),
      layers_pa_(tissue.youngs_modulus_pa),
      means_(queue, grid),
      shares_(means_.shares(solid_of(grid, tissue, poisson_ratio), u, u)) {}

FeltModulus EnergyShares::felt(const SolidTissue& tissue, double softer) {
  std::vector<float> logarithm(tissue.youngs_modulus_pa.size()), stiffer(logarithm), weaker(logarithm);
  for (std::size_t e = 0; e < logarithm.size(); ++e) {
    const double ratio = softer * tissue.youngs_modulus_pa[e] / layers_pa_[e / columns_];
    logarithm[e] = static_cast<float>(std::log(ratio));
    stiffer[e] = static_cast<float>(ratio - 1);
    weaker[e] = static_cast<float>(1 / ratio - 1);
  }
  FeltModulus out;
  const auto mean = [&](const std::vector<float>& map) {
    return means_.means(shares_, means_.transformed(map));
  };
  const Eigen::ArrayXd m = mean(logarithm), stiff = mean(stiffer), weak = mean(weaker);
  out.scale = (-m / 2).exp();
  out.beyond = ((1 + weak) * m.exp() - 1).max(1 - (-m).exp() / (1 + stiff)).max(0.0);
  // Finer forces than what D scales are left as they were: that share of a contact's energy, about.
  out.beyond.array() += kFineShare * (out.scale.array().square() - 1).abs();
  if (!out.scale.allFinite() || !out.beyond.allFinite())
    throw std::domain_error("solid: how it is felt at the surface is not finite");
  return out;
}

}  // namespace teletact::service
