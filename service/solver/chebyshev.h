// Coefficients of the Chebyshev iteration (Saad, Iterative Methods, algorithm 12.1) on [lowest, highest].
#pragma once

#include <vector>

namespace teletact::service {

// Step k: d = old d + new D^-1 r, z += d.
struct ChebyshevStep {
  double old_direction = 0, new_residual = 0;
};

inline std::vector<ChebyshevStep> chebyshev_steps(double lowest, double highest, unsigned steps) {
  const double theta = (highest + lowest) / 2, delta = (highest - lowest) / 2, sigma = theta / delta;
  std::vector<ChebyshevStep> out{{0, 1 / theta}};
  double rho = 1 / sigma;
  while (out.size() < steps) {
    const double next = 1 / (2 * sigma - rho);
    out.push_back({next * rho, 2 * next / delta});
    rho = next;
  }
  return out;
}

}  // namespace teletact::service
