#include "service/contact/tactile_image.h"

#include <algorithm>
#include <cmath>
#include <exception>

namespace teletact::service {
namespace {

// Along one axis, in taxels from the grid's begin.
struct Shares {
  std::size_t first = 0;
  std::vector<double> of;      // of taxel first, first + 1, ...
  double sum = 0, moment = 0;  // about the grid's centre, in taxels
};

Shares shares(double at, double width, std::size_t taxels) {
  constexpr double kRounding = 1e-9;  // a share as wide as a taxel covers one
  const double covers = std::max(1.0, std::ceil(width - kRounding));
  const double begin = at - covers / 2, end = at + covers / 2, n = static_cast<double>(taxels);
  Shares out;
  if (!(end > 0 && begin < n)) return out;
  out.first = static_cast<std::size_t>(std::max(0.0, std::floor(begin)));
  for (std::size_t i = out.first; i < taxels && static_cast<double>(i) < end; ++i) {
    const double left = static_cast<double>(i);
    const double share = (std::min(end, left + 1) - std::max(begin, left)) / covers;
    out.of.push_back(share);
    out.sum += share;
    out.moment += share * (left + 0.5 - n / 2);
  }
  return out;
}

}  // namespace

Taxels share_among_taxels(std::span<const NodalPressure> nodes, const TaxelGrid& grid,
                          std::array<double, 2> centre_m) {
  Taxels out;
  out.pressure_pa.assign(grid.along_x * grid.along_z, 0.0);
  const double pitch = grid.pitch_m, area = pitch * pitch;
  for (const NodalPressure& node : nodes) {
    const double force = node.pressure_pa * node.width_m[0] * node.width_m[1];
    const double x_m = node.position_m[0] - centre_m[0], z_m = node.position_m[2] - centre_m[1];
    const Shares x =
        shares(x_m / pitch + static_cast<double>(grid.along_x) / 2, node.width_m[0] / pitch, grid.along_x);
    const Shares z =
        shares(z_m / pitch + static_cast<double>(grid.along_z) / 2, node.width_m[1] / pitch, grid.along_z);
    for (std::size_t k = 0; k < z.of.size(); ++k)
      for (std::size_t i = 0; i < x.of.size(); ++i)
        out.pressure_pa[(z.first + k) * grid.along_x + x.first + i] += force * z.of[k] * x.of[i] / area;
    out.force_n += force;
    out.outside_n += force * std::max(0.0, 1 - x.sum * z.sum);  // not below it by rounding
    out.outside_moment_n_m[0] += force * (x_m - pitch * x.moment * z.sum);
    out.outside_moment_n_m[1] += force * (z_m - pitch * z.moment * x.sum);
  }
  return out;
}

TactileImage tactile_image(const TouchedLayer& layer, const Fingertip& tip, const TouchPose& pose,
                           std::span<const NodalPressure> nodes, const TaxelGrid& grid,
                           const Vector3& centre_m) {
  const std::array<double, 2> centre{centre_m[0], centre_m[2]};
  TactileImage image{centre_m, grid, share_among_taxels(nodes, grid, centre), {}};
  try {
    const auto layered = layer.layered_pressure(tip, pose, image.pressure.force_n);
    if (!layered) return image;
    image.beyond_pa = image.pressure.pressure_pa;
    const Taxels without = share_among_taxels(*layered, grid, centre);
    for (std::size_t t = 0; t < image.beyond_pa.size(); ++t) image.beyond_pa[t] -= without.pressure_pa[t];
  } catch (const std::exception&) {  // the model's limits, at the depth that bears the force: not known
  }
  return image;
}

}  // namespace teletact::service
