#include "bench/independent/touched_block.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace teletact::bench {

double round_touch_n(const RoundTouch& touch, double across) {
  constexpr double kGrowth = .5, kUnder = 1.5, kWideDepths = 2.5, kSlab = .15, kSlabAside = .3;
  const double hertz_m = std::sqrt(touch.radius_m * touch.indentation_m),  // radius of the contact
      fine_m = hertz_m / across, far_m = kWideDepths * touch.depth_m;
  const auto size = [&](double of_depth) {
    return [=, depth_m = touch.depth_m](double at_m) {
      return std::min(fine_m + kGrowth * std::max(0., std::abs(at_m) - kUnder * hertz_m), of_depth * depth_m);
    };
  };
  const auto between = [&](double begin_m, double end_m) {
    return graded_lines({std::max(begin_m, -far_m), 0, std::min(end_m, far_m)}, size(kSlabAside));
  };
  const Hexahedra mesh({between(touch.sides.left_m, touch.sides.right_m),
                        graded_lines({0, touch.depth_m}, size(kSlab)),
                        between(touch.sides.near_m, touch.sides.far_m)});
  const Hexahedra::Moduli moduli_pa = mesh.means(touch.modulus_pa);
  const auto pressed_within = [&](double radius_m) {
    constexpr double kNear = 1e-9, kFree = std::numeric_limits<double>::quiet_NaN();
    Eigen::Matrix3Xd prescribed_m = Eigen::Matrix3Xd::Constant(3, mesh.size(), kFree);
    for (Eigen::Index n = 0; n < mesh.size(); ++n) {
      const Hexahedra::Point& p = mesh.node(n);
      const double r = std::hypot(p.x(), p.z());
      if (p.y() > touch.depth_m - kNear)
        prescribed_m.col(n) = touch.slides ? Hexahedra::Point(kFree, 0, kFree) : Hexahedra::Point::Zero();
      else if (p.y() < kNear && r < radius_m)
        prescribed_m(1, n) = touch.indentation_m - r * r / (2 * touch.radius_m);
    }
    const Hexahedra::Solution s = mesh.solve(moduli_pa, touch.poisson_ratio, prescribed_m);
    double force_n = 0;
    for (Eigen::Index n = 0; n < mesh.size(); ++n)
      if (mesh.node(n).y() < kNear && std::hypot(mesh.node(n).x(), mesh.node(n).z()) < radius_m)
        force_n += s.force_n(1, n);
    return force_n;
  };
  double most_n = 0;
  for (const double of_hertz : {.9, 1., 1.1}) most_n = std::max(most_n, pressed_within(of_hertz * hertz_m));
  return most_n;
}

}  // namespace teletact::bench
