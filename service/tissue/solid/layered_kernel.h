// How the surface of stacked layers gives way to a pressure that waves along it: exact, no mesh (T9.1).
#pragma once

#include <vector>

namespace teletact::service {

// Layers of Young's modulus [0] at the surface first, the last one bonded to rigid ground.
struct LayerStack {
  std::vector<double> thickness_m, youngs_modulus_pa;  // > 0, as many
  double poisson_ratio = 0.49;                         // 0 <= . < 0.5
};

// M(s): normal displacement of the surface under the pressure cos(s x), frictionless, over that of a half
// space of the topmost modulus, 2 (1 - nu^2) / (E s). It goes to 1 for short waves and to 0 with s for long
// ones. s > 0, 1/m. Each layer's exact solutions, eliminated from the ground up.
double layered_kernel(const LayerStack&, double s);

}  // namespace teletact::service
