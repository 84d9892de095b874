// Young's modulus of tissue at any point, its texture with it.
#pragma once

#include <vector>

#include "client/patient/tissue.h"

namespace teletact::client {

class TrueModulus {
 public:
  // `tissue` must outlive it.
  explicit TrueModulus(const Tissue& tissue);
  double operator()(double x_m, double y_m, double z_m = 0) const;  // Pa
  // What texture makes of it at a point: a factor.
  double texture(double x_m, double y_m, double z_m) const;

 private:
  struct Wave {
    double x, y, z, phase;  // per metre
  };
  const Tissue& tissue_;
  std::vector<Wave> waves_;
};

}  // namespace teletact::client
