// Tissue in closed form, conservative as T4.5 asks: U(x, z, d) = K(x, z) d^2.5 (a rounded tip), with Gaussian
// inclusions: across the plane the same everywhere, or, in a solid, round. Used by the tests of every part
// between an answer and the device.
#pragma once

#include <cmath>
#include <vector>

#include "client/render/renderer.h"

namespace teletact::client::test {

struct AnalyticTissue {
  struct Inclusion {
    double x_m;
    double contrast;  // K / K_0 at its middle
    double sigma_m;
  };
  double stiffness = 950;  // K_0, N / m^1.5: 0.6 N at 4 mm
  double surface_m = 0;
  bool solid = false;  // the inclusions end along z, too: their middles lie at z = 0
  std::vector<Inclusion> inclusions = {{0.03, 2, 0.005}, {0.06, 3, 0.006}, {0.09, 1.5, 0.004}};

  ForceSample answer(const Vector3& position_m, double time_s = 0, std::uint64_t sequence = 1) const {
    ForceSample sample;
    sample.sequence = sequence;
    sample.pose_time_s = time_s;
    sample.position_m = position_m;
    sample.surface.offset_m = surface_m;
    const double d = position_m.y() - surface_m;
    if (d <= 0) return sample;
    double k = stiffness, k_x = 0, k_xx = 0, k_z = 0, k_xz = 0, k_zz = 0;  // K and its derivatives
    for (const Inclusion& inclusion : inclusions) {
      const double s2 = inclusion.sigma_m * inclusion.sigma_m;
      const double u = position_m.x() - inclusion.x_m, w = solid ? position_m.z() : 0;
      const double bump = stiffness * (inclusion.contrast - 1) * std::exp(-(u * u + w * w) / (2 * s2));
      k += bump;
      k_x += -u / s2 * bump;
      k_xx += (u * u / s2 - 1) / s2 * bump;
      if (!solid) continue;
      k_z += -w / s2 * bump;
      k_xz += u * w / (s2 * s2) * bump;
      k_zz += (w * w / s2 - 1) / s2 * bump;
    }
    const double d15 = std::pow(d, 1.5), d25 = std::pow(d, 2.5);
    sample.contact = true;
    sample.force_n = -Vector3(k_x * d25, 2.5 * k * d15, k_z * d25);
    sample.tangent_n_m << -k_xx * d25, -2.5 * k_x * d15, -k_xz * d25,  //
        -2.5 * k_x * d15, -3.75 * k * std::sqrt(d), -2.5 * k_z * d15,  //
        -k_xz * d25, -2.5 * k_z * d15, -k_zz * d25;
    return sample;
  }

  // As the service tells it: out of contact, what waits below the finger.
  ForceSample told(const Vector3& position_m, double time_s = 0, std::uint64_t sequence = 1) const {
    if (position_m.y() > surface_m) return answer(position_m, time_s, sequence);
    ForceSample sample = answer({position_m.x(), surface_m + 5e-4, position_m.z()}, time_s, sequence);
    sample.contact = false;
    sample.foreseen = true;
    return sample;
  }
};

}  // namespace teletact::client::test
