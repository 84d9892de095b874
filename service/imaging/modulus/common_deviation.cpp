#include "service/imaging/modulus/common_deviation.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "service/device/cancellation.h"
#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

// By how much ln of a node's force over its strain, of homogeneous tissue under the probe, is another in
// `other` tissue: median over the nodes that say something.
double moved_by(const ModulusInput& in, const TissueExtent& other, StripCache& strips,
                const ModulusEstimate& out) {
  const auto log_stiffness = [&](const TissueExtent& tissue) {
    const auto entry = strips.get(tissue, in.window_width_m);
    Field stiffness = entry->model.on_image(entry->homogeneous.stress, in.measured.grid);
    for (float& s : stiffness) s = static_cast<float>(std::log(entry->homogeneous.force_n_per_m / -s));
    return stiffness;
  };
  const Field now = log_stiffness(in.tissue), then = log_stiffness(other);
  std::vector<float> moved;
  for (std::size_t n = 0; n < now.size(); ++n)
    if (std::isfinite(out.youngs_modulus[n]) && std::isfinite(then[n] - now[n]))
      moved.push_back(then[n] - now[n]);
  return moved.empty() ? 0 : median(moved);
}

// A solid, whose load spreads: as a half-space, and more the shallower it is.
double poisson_slope_of_solid(const ModulusInput& in) {
  constexpr double kConfined = 2;  // by solves of solids whose depth is 1 to 2.5 times the root of their face
  const double nu = in.tissue.poisson_ratio, depth_m = in.tissue.depth_m;
  return 2 * nu / (1 - nu * nu) * (1 + kConfined * in.force->contact_area_m2 / (depth_m * depth_m));
}

// One more solve for each; the depth and the width of a solid are its fit's.
double tissue_deviation(const ModulusInput& in, StripCache& strips, const ModulusEstimate& out) {
  const TissueExtent& tissue = in.tissue;
  const auto by = [&](double deviation, auto change) {
    if (!(deviation > 0)) return 0.0;
    TissueExtent other = tissue;
    change(other, deviation);
    return moved_by(in, other, strips, out);
  };
  const bool solid = out.kind == ModulusKind::kSolid;
  const bool narrow = solid && in.force->contact_area_m2 < in.window_width_m * tissue.depth_m;
  const double by_nu = narrow ? tissue.poisson_std * poisson_slope_of_solid(in)
                              : by(tissue.poisson_std, [](auto& t, double d) {
                                  t.poisson_ratio = std::max(0.0, t.poisson_ratio - d);
                                });
  if (solid) return by_nu;
  return std::hypot(
      by_nu,
      by(tissue.depth_std_m, [](auto& t, double d) { t.depth_m = std::max(t.depth_m / 2, t.depth_m - d); }),
      by(tissue.beside_std_m, [](auto& t, double d) { t.width_m += 2 * d, t.window_x_m += d; }));
}

// Another speed of sound scales depth and displacement alike. Strain stays, and lies so much deeper:
// d ln E / d ln c = d ln stress / d ln y, stress = E |eps_yy|; its straight line over the nodes.
double sound_speed_slope(const ModulusInput& in, const ModulusEstimate& out) {
  const Measured& m = in.measured;
  double n = 0;
  Eigen::Vector2d sum = Eigen::Vector2d::Zero(), products = sum;  // of ln y and ln stress; with ln y
  for (std::size_t k = 0; k < m.grid.size(); ++k) {
    if (k % m.grid.nx == 0) check_cancelled();
    const double y_m = m.grid.y_m(k), stress = out.youngs_modulus[k] * std::abs(m.axial_strain[k]);
    if (!m.strain_valid[k] || !(y_m > 0) || !(stress > 0) || !std::isfinite(stress)) continue;
    const Eigen::Vector2d at(std::log(y_m), std::log(stress));
    ++n, sum += at, products += at[0] * at;
  }
  const Eigen::Vector2d covariance = n * products - sum[0] * sum;
  return covariance[0] > 0 ? covariance[1] / covariance[0] : 0;
}

}  // namespace

double common_deviation(const ModulusInput& in, StripCache& strips, const ModulusEstimate& out) {
  if (!out.absolute) return 0;
  const double by_c =
      in.sound_speed_deviation > 0 ? in.sound_speed_deviation * sound_speed_slope(in, out) : 0;
  if (!in.force)  // by a pad, beside whose strain nu counts for nothing
    return std::hypot(by_c, in.tissue.pad->youngs_modulus_std_pa / in.tissue.pad->youngs_modulus_pa);
  return std::hypot(in.force->deviation(), tissue_deviation(in, strips, out), by_c);
}

}  // namespace teletact::service
