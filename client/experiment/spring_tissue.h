// Tissue in closed form for observers to feel: U(x, d) = 1/2 K(x) d^2, conservative as (T4.5) asks, so that
// the stiffness felt is K(x) whatever the depth; the same for every z.
#pragma once

#include <cmath>
#include <limits>

#include "client/render/renderer.h"

namespace teletact::client {

// The answer of U(x, d) = 1/2 K(x) d^2 at a place [x, d, z] where K is k, its derivatives `slope` and `bend`.
inline ForceSample spring_answer(const Vector3& position_m, double k, double slope, double bend) {
  ForceSample sample;
  sample.position_m = position_m;
  const double d = position_m.y();
  if (d <= 0) return sample;
  sample.contact = true;
  sample.force_n = {-slope * d * d / 2, -k * d, 0};
  sample.tangent_n_m << -bend * d * d / 2, -slope * d, 0,  //
      -slope * d, -k, 0,                                   //
      0, 0, 0;
  return sample;
}

// A stimulus in a background: a plateau between two logistic edges.
struct SpringTissue {
  double background_n_m = 0, stimulus_n_m = 0;
  double centre_m = 0;
  double half_width_m = std::numeric_limits<double>::infinity();  // no end: the stimulus everywhere
  double edge_m = 0.0015;                                         // 4.4 times this from 10 to 90 %

  ForceSample answer(const Vector3& position_m) const {
    const auto edge = [this](double u_m) { return 1 / (1 + std::exp(-u_m / edge_m)); };
    const double in = edge(position_m.x() - centre_m + half_width_m);
    const double out = edge(position_m.x() - centre_m - half_width_m);
    const double step_n_m = stimulus_n_m - background_n_m;
    const double slope_in = in * (1 - in) / edge_m, slope_out = out * (1 - out) / edge_m;
    const double k = background_n_m + step_n_m * (in - out);
    const double slope = step_n_m * (slope_in - slope_out);
    const double bend = step_n_m * (slope_in * (1 - 2 * in) - slope_out * (1 - 2 * out)) / edge_m;
    return spring_answer(position_m, k, slope, bend);
  }
};

}  // namespace teletact::client
