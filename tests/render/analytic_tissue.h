// Tissue in closed form, conservative as T4.5 asks: U(x, d) = K(x) d^2.5 (a rounded tip), with Gaussian
// inclusions along x. Used by the tests of every part between an answer and the device.
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
  std::vector<Inclusion> inclusions = {{0.03, 2, 0.005}, {0.06, 3, 0.006}, {0.09, 1.5, 0.004}};

  ForceSample answer(const Vector2& position_m, double time_s = 0, std::uint64_t sequence = 1) const {
    ForceSample sample;
    sample.sequence = sequence;
    sample.pose_time_s = time_s;
    sample.position_m = position_m;
    sample.surface_m = surface_m;
    const double d = position_m.y() - surface_m;
    if (d <= 0) return sample;
    double k = stiffness, dk = 0, ddk = 0;  // K, K', K''
    for (const Inclusion& inclusion : inclusions) {
      const double s2 = inclusion.sigma_m * inclusion.sigma_m;
      const double u = position_m.x() - inclusion.x_m;
      const double bump = stiffness * (inclusion.contrast - 1) * std::exp(-u * u / (2 * s2));
      k += bump;
      dk += -u / s2 * bump;
      ddk += (u * u / s2 - 1) / s2 * bump;
    }
    sample.contact = true;
    sample.force_n = Vector2(-dk * std::pow(d, 2.5), -2.5 * k * std::pow(d, 1.5));
    sample.tangent_n_m << -ddk * std::pow(d, 2.5), -2.5 * dk * std::pow(d, 1.5),  //
        -2.5 * dk * std::pow(d, 1.5), -3.75 * k * std::sqrt(d);
    return sample;
  }

  // As the service tells it: out of contact, what waits below the finger.
  ForceSample told(const Vector2& position_m, double time_s = 0, std::uint64_t sequence = 1) const {
    if (position_m.y() > surface_m) return answer(position_m, time_s, sequence);
    ForceSample sample = answer({position_m.x(), surface_m + 5e-4}, time_s, sequence);
    sample.contact = false;
    sample.foreseen = true;
    return sample;
  }
};

}  // namespace teletact::client::test
