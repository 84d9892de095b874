// Displacement of an incompressible plane-strain medium with a stiff circular inclusion under uniform
// compression: the exact solution. With E = (-e, e) on the diagonal, q = (R / r)^2, k = 2 / (1 + contrast):
//   inside   u = k E x
//   outside  u = E x (1 + (k - 1) q^2) + x (x.E x) / r^2 * 2 (k - 1) (q - q^2)
#pragma once

#include <utility>

namespace teletact::service {

struct StiffInclusion {
  double strain = 0, contrast = 1;  // axial, far away; ratio of the moduli
  double radius_m = 0, x_m = 0, y_m = 0;

  // (lateral, axial) displacement in metres; at rest at (x_m, 0) far from the inclusion.
  std::pair<double, double> at(double x, double y) const {
    const double k = 2 / (1 + contrast), dx = x - x_m, dy = y - y_m, squared = dx * dx + dy * dy;
    const double ex = -strain * dx, ey = strain * dy, rigid = strain * y_m;
    if (squared < radius_m * radius_m) return {k * ex, k * ey + rigid};
    const double q = radius_m * radius_m / squared;
    const double along = 1 + (k - 1) * q * q,
                 radial = 2 * (k - 1) * (q - q * q) * (dx * ex + dy * ey) / squared;
    return {along * ex + radial * dx, along * ey + radial * dy + rigid};
  }
};

}  // namespace teletact::service
