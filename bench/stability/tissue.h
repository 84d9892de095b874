// Tissue in closed form for stability trials: U(x, d) = 1/2 K(x) d^2, conservative as (T4.5) asks, so that
// the stiffness felt is K(x) whatever the depth. Homogeneous, or with round inclusions along x whose middle
// has the stated largest stiffness.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "bench/stability/spring_law.h"
#include "client/experiment/spring_tissue.h"

namespace teletact::bench {

enum class Scene { kHomogeneous, kInclusions };
inline const char* to_string(Scene scene) {
  return scene == Scene::kHomogeneous ? "homogeneous" : "inclusions";
}

class StabilityTissue {
 public:
  static constexpr double kContrast = 3;
  // K(x) is at most `largest_n_m`.
  StabilityTissue(Scene scene, double largest_n_m)
      : background_n_m_(scene == Scene::kHomogeneous ? largest_n_m : largest_n_m / kContrast) {
    if (scene == Scene::kInclusions) centres_m_ = {0.03, 0.06, 0.09};
  }
  double background_n_m() const { return background_n_m_; }

  client::ForceSample answer(const client::Vector3& position_m) const {
    double k = background_n_m_, slope = 0, bend = 0;  // K, K', K''
    for (const double centre_m : centres_m_) {
      const double u = (position_m.x() - centre_m) / kWidthM;
      const double bump = (kContrast - 1) * background_n_m_ * std::exp(-u * u / 2);
      k += bump;
      slope -= u / kWidthM * bump;
      bend += (u * u - 1) / (kWidthM * kWidthM) * bump;
    }
    return client::spring_answer(position_m, k, slope, bend);
  }
  double energy_j(const client::Vector3& position_m) const {
    return -0.5 * answer(position_m).force_n.y() * std::max(position_m.y(), 0.0);
  }
  // As the service tells it: out of contact, what waits below the finger.
  client::ForceSample told(const client::Vector3& position_m) const {
    if (position_m.y() > 0) return answer(position_m);
    client::ForceSample sample = answer({position_m.x(), kForeseenM, position_m.z()});
    sample.contact = false;
    sample.foreseen = true;
    return sample;
  }
  // Its contact law from x = -2 mm to `end_m`, at most 124 mm.
  client::NearLaw law(std::uint64_t version, double end_m = 0.124) const {
    return spring_law(*this, -0.002, 0.002, end_m, version);
  }
  client::Vector3 force_n(const client::Vector3& position_m) const { return answer(position_m).force_n; }

 private:
  static constexpr double kForeseenM = 5e-4;
  static constexpr double kWidthM = 0.005;  // standard deviation: 12 mm wide
  double background_n_m_;
  std::vector<double> centres_m_;
};

}  // namespace teletact::bench
