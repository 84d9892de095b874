// Tissue of the solid forward model under a probe of 30 x 5 mm on 20 mm, which is solved fast.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <random>
#include <vector>

#include "service/imaging/modulus/cell_strains.h"
#include "service/imaging/modulus/modulus.h"
#include "service/imaging/modulus/probed_tissue.h"
#include "tests/imaging/imaging_device.h"

namespace teletact::service::test {

inline constexpr double kWidthM = 0.030, kElevationM = 0.005, kDepthM = 0.020;
inline constexpr double kPushM = 0.4e-3, kModulusPa = 10e3, kNoise = 0.01;
inline constexpr double kNowhere = std::numeric_limits<double>::infinity();

inline ProbeFace face(double beside_m = kNowhere, bool slides = false) {
  ProbeFace f{kWidthM, kElevationM, kDepthM, kDepthM, 0.49};
  f.beside_m = beside_m, f.slides = slides;
  return f;
}

inline std::shared_ptr<ProbedTissue> solid(const ProbeFace& f) {
  return make_probed_solid(imaging_device()->queue(), f);
}

// What an estimate gets of tissue under such a face, with white noise: homogeneous, or with so much of ln E.
class Pressed {
 public:
  using Of = std::function<double(double x_m, double y_m)>;
  explicit Pressed(
      const ProbeFace& f, const Of& strained = [](double, double) { return 1.0; },
      const Of& log_modulus = [](double, double) { return 0.0; }, unsigned seed = 7) {
    const auto tissue = solid(f);
    const CellGrid& cells = tissue->cells();
    Eigen::VectorXd theta(static_cast<Eigen::Index>(cells.size()));
    for (std::size_t c = 0; c < cells.size(); ++c)
      theta[static_cast<Eigen::Index>(c)] = log_modulus(cells.x_m(c), cells.y_m(c));
    const auto response = tissue->push(theta, 0, {});
    force = ProbeForce{kModulusPa * kPushM * response.force_n / tissue->force_share(), kWidthM * kElevationM};
    const auto axial = as_measured(response.axial_strain, tissue->cells(), {}),
               lateral = as_measured(response.lateral_strain, tissue->cells(), {});
    Measured& m = measured;
    m.grid = {59, 39, 0.5e-3, 0.5e-3, 0.5e-3, 0.5e-3};
    std::mt19937 random(seed);
    std::normal_distribution<double> normal(0, kNoise);
    const Field nothing(m.grid.size(), 0.0F);
    m.axial_displacement = m.lateral_displacement = m.axial_displacement_std = m.lateral_displacement_std =
        m.shear_strain = m.lateral_strain_std = m.shear_strain_std = nothing;
    m.correlation.assign(m.grid.size(), 1.0F);
    m.displacement_valid.assign(m.grid.size(), 1), m.strain_valid = m.displacement_valid;
    for (std::size_t n = 0; n < m.grid.size(); ++n) {
      const double as = kPushM * strained(m.grid.x_m(n), m.grid.y_m(n)) * (1 + normal(random)),
                   strain = as * at_node(axial, tissue->cells(), m.grid, 0, n);
      m.axial_strain.push_back(static_cast<float>(strain));
      m.lateral_strain.push_back(static_cast<float>(as * at_node(lateral, tissue->cells(), m.grid, 0, n)));
      m.axial_strain_noise.push_back(static_cast<float>(std::abs(kNoise * strain)));
    }
  }

  ModulusEstimate estimate(const ModulusBudget& budget = {}, std::optional<double> beside_m = {},
                           double depth_m = kDepthM, const Surface& surface = {},
                           double elevation_m = kElevationM, double beside_std_m = 0) const {
    TissueExtent tissue{0.1, depth_m, 0.035, 0.49, Plane::kSolid, elevation_m};
    tissue.surface = surface;
    tissue.beside_m = beside_m, tissue.beside_std_m = beside_std_m;
    return make_solid(imaging_device()->queue(), {})
        ->estimate({measured, kWidthM, tissue, force, {}, budget});
  }

  Measured measured;
  std::optional<ProbeForce> force;
};

inline double background(const ModulusEstimate& e, const Measured& m) {
  std::vector<float> values;
  for (std::size_t n = 0; n < m.grid.size(); ++n)
    if (m.grid.y_m(n) > 0.003 && std::isfinite(e.youngs_modulus[n])) values.push_back(e.youngs_modulus[n]);
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

inline bool warned(const ModulusEstimate& e, ModulusFlag flag) {
  return std::any_of(e.warnings.begin(), e.warnings.end(), [&](const Warning& w) { return w.flag == flag; });
}

}  // namespace teletact::service::test
