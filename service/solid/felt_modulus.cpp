#include "service/solid/felt_modulus.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "service/device/look.h"
#include "service/solid/hexahedron.h"

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
    : queue_(queue),
      grid_(grid),
      layers_pa_(tissue.youngs_modulus_pa),
      elements_(queue, grid.nx, grid.nz, grid.layers()),
      surface_(queue, grid.nx, grid.nz, 1),
      field_(queue.array<float>(elements_.field_size())),
      spectrum_(queue.array<float>(elements_.spectrum_size())),
      plane_(queue.array<float>(surface_.field_size())),
      sum_(queue.array<float>(surface_.spectrum_size())) {
  const std::size_t nx = grid.nx, nz = grid.nz, columns = grid.columns();
  std::vector<double> energy(grid.elements());
  for (std::size_t j = 0; j < grid.layers(); ++j) {
    const HexahedronMatrix k =
        tissue.youngs_modulus_pa[j] * hexahedron_stiffness(grid.spacing_x_m, grid.y_m[j + 1] - grid.y_m[j],
                                                           grid.spacing_z_m, poisson_ratio);
    for (std::size_t z = 0; z < nz; ++z) {
      look();
      for (std::size_t x = 0; x < nx; ++x) {
        Eigen::Matrix<double, 24, 1> moved = Eigen::Matrix<double, 24, 1>::Zero();
        for (std::size_t corner = 0; corner < 8; ++corner) {
          const std::size_t row = j + corner / 4;
          if (row == grid.layers()) continue;  // held
          const std::size_t node = (x + corner % 2) % nx + nx * ((z + corner / 2 % 2) % nz);
          for (std::size_t c = 0; c < 3; ++c)
            moved[static_cast<Eigen::Index>(3 * corner + c)] = u[(3 * row + c) * columns + node];
        }
        energy[(j * nz + z) * nx + x] = moved.dot(k * moved);
      }
    }
  }
  double sum = 0;
  for (const double e : energy) sum += e;
  std::vector<float> shares;
  shares.reserve(energy.size());
  for (const double e : energy) shares.push_back(static_cast<float>(e / sum));
  queue_.write(field_, shares.data(), shares.size());
  elements_.forward(field_, spectrum_, 0, grid.layers());
  shares_ = queue_.read(spectrum_);
}

// Over the elements, of each node, with the shares around it: a correlation.
Eigen::VectorXd EnergyShares::mean(const std::vector<float>& of_elements) {
  queue_.write(field_, of_elements.data(), of_elements.size());
  elements_.forward(field_, spectrum_, 0, grid_.layers());
  const std::vector<float> spectrum = queue_.read(spectrum_);
  const std::size_t part = surface_.spectrum_size() / 2;  // real, imaginary
  std::vector<float> sum(2 * part);
  for (std::size_t j = 0; j < grid_.layers(); ++j) {
    const float *real = spectrum.data() + 2 * j * part, *imaginary = real + part;
    const float *share_real = shares_.data() + 2 * j * part, *share_imaginary = share_real + part;
    for (std::size_t k = 0; k < part; ++k) {
      sum[k] += share_real[k] * real[k] + share_imaginary[k] * imaginary[k];
      sum[part + k] += share_real[k] * imaginary[k] - share_imaginary[k] * real[k];
    }
  }
  queue_.write(sum_, sum.data(), sum.size());
  surface_.backward(sum_, plane_, 0, 1);
  const std::vector<float> means = queue_.read(plane_);
  return Eigen::Map<const Eigen::VectorXf>(means.data(), static_cast<Eigen::Index>(means.size()))
      .cast<double>();
}

FeltModulus EnergyShares::felt(const SolidTissue& tissue, double softer) {
  const std::size_t columns = grid_.columns();
  std::vector<float> logarithm(tissue.youngs_modulus_pa.size()), stiffer(logarithm), weaker(logarithm);
  for (std::size_t e = 0; e < logarithm.size(); ++e) {
    const double ratio = softer * tissue.youngs_modulus_pa[e] / layers_pa_[e / columns];
    logarithm[e] = static_cast<float>(std::log(ratio));
    stiffer[e] = static_cast<float>(ratio - 1);
    weaker[e] = static_cast<float>(1 / ratio - 1);
  }
  FeltModulus out;
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
