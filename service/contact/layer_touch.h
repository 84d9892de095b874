// The cheapest model of a touch of solid tissue (T9.0): a rounded tip (its paraboloid) pressed without
// friction on a homogeneous layer that is bonded to what does not move, unbounded sideways. Exact, by a table
// that is made once for a Poisson ratio; no device, a microsecond a touch.
#pragma once

#include <vector>

namespace teletact::service {

struct LayerForce {
  double force_n = 0;        // against the indentation
  double stiffness_n_m = 0;  // its derivative by the indentation
  double contact_radius_m = 0;
};

// Immutable: by any number of threads.
class LayerTouch {
 public:
  // sqrt(radius x indentation) / depth up to which it knows the force.
  static constexpr double kMostRatio = 2.5;
  // 0 <= poisson_ratio < 0.5, else std::invalid_argument.
  explicit LayerTouch(double poisson_ratio);
  double poisson_ratio() const { return poisson_ratio_; }
  // Nothing where the indentation is not above 0. Throws std::invalid_argument (what of it named) unless the
  // others are positive and all are finite, std::out_of_range beyond kMostRatio.
  LayerForce touch(double youngs_modulus_pa, double depth_m, double radius_m, double indentation_m) const;

 private:
  // By sqrt(radius x indentation) / depth: ln of the force over Hertz's, the force's power of the
  // indentation, and the contact's radius over Hertz's.
  struct Row {
    double ratio, ln_force, power, radius;
  };
  double poisson_ratio_;
  std::vector<Row> rows_;  // by growing ratio
};

}  // namespace teletact::service
