#include "bench/independent/touched_block.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

namespace teletact::bench {

double round_touch_n(const RoundTouch& touch, double across) {
  constexpr double kNear = 1e-6, kFree = std::numeric_limits<double>::quiet_NaN();
  constexpr double kGrowth = 2, kUnder = 1.5, kFarDepths = 2.5, kSlab = .6,
                   kSlabAside = 1.2;  // over `across`
  const Sides& sides = touch.sides;
  if (!(std::max(sides.left_m, sides.near_m) < -kNear && std::min(sides.right_m, sides.far_m) > kNear))
    throw std::invalid_argument("the tip's axis does not enter the tissue");
  const double hertz_m = std::sqrt(touch.radius_m * touch.indentation_m),  // radius of the contact
      bottom_m = touch.depth_m + touch.bed_m, far_m = kFarDepths * bottom_m,
               right_m = std::min(sides.right_m, far_m);
  const auto size = [&](double of_depth) {
    return [=, depth_m = touch.depth_m](double at_m) {
      return std::min(hertz_m + kGrowth * std::max(0., std::abs(at_m) - kUnder * hertz_m),
                      of_depth * depth_m) /
             across;
    };
  };
  const auto between = [&](double begin_m, double end_m) {
    return graded_lines({std::max(begin_m, -far_m), 0, std::min(end_m, far_m)}, size(kSlabAside));
  };
  const Hexahedra mesh({between(sides.left_m, sides.right_m),
                        graded_lines({0, touch.depth_m, bottom_m}, size(kSlab)),
                        between(sides.near_m, sides.far_m)});
  const Hexahedra::Moduli moduli_pa = mesh.means(touch.modulus_pa);
  const auto pressed_within = [&](double radius_m) {
    Eigen::Matrix3Xd prescribed_m = Eigen::Matrix3Xd::Constant(3, mesh.size(), kFree);
    for (Eigen::Index n = 0; n < mesh.size(); ++n) {
      const Hexahedra::Point& p = mesh.node(n);
      const double r = std::hypot(p.x(), p.z());
      if (p.y() > bottom_m - kNear) {
        // What slides keeps its middle and its direction.
        const bool held = !touch.slides || r < kNear;
        prescribed_m(1, n) = 0;
        if (held) prescribed_m(0, n) = 0;
        if (held || (p.x() > right_m - kNear && std::abs(p.z()) < kNear)) prescribed_m(2, n) = 0;
      } else if (p.y() < kNear && r < radius_m) {
        prescribed_m(1, n) = touch.indentation_m - r * r / (2 * touch.radius_m);
      }
    }
    const Hexahedra::Solution s = mesh.solve(moduli_pa, touch.poisson_ratio, prescribed_m);
    double force_n = 0;
    for (Eigen::Index n = 0; n < mesh.size(); ++n)
      if (mesh.node(n).y() < kNear && std::hypot(mesh.node(n).x(), mesh.node(n).z()) < radius_m)
        force_n += s.force_n(1, n);
    return force_n;
  };
  // From less than Hertz's circle on, to where it grows no more.
  constexpr double kFirst = .9, kStep = .1, kLast = 1.6;
  double most_n = pressed_within(kFirst * hertz_m);
  for (double of_hertz = kFirst + kStep; of_hertz < kLast; of_hertz += kStep) {
    const double force_n = pressed_within(of_hertz * hertz_m);
    if (force_n < most_n) break;
    most_n = force_n;
  }
  return most_n;
}

}  // namespace teletact::bench
