#include "service/contact/plane_dimension.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace teletact::service {
namespace {

using std::numbers::pi;

// Logarithms of what the ratio of both forces may be off by at most (plane_dimension_test): by the closed
// forms of narrow contacts; of wide ones, times the square of the plane's half-width over the depth; and by
// lumps and layers, of a spread s times s / (1 + s).
constexpr double kOfForms = 0.06, kOfWide = 3, kOfSpread = 0.6;

// Over Young's modulus.
double plane_strain_modulus(const PressedLayer& layer) {
  return 1 / (1 - layer.poisson_ratio * layer.poisson_ratio);
}

// Half of the plane's contact, a: F' = pi E* a^2 / (4 R), d = a^2 / (4 R) (2 ln(2 h / a) - nu / (1 - nu)).
// known_m: the indentation that it is of, no deeper than where d grows no more.
struct PlaneContact {
  double a_m, known_m;
};
PlaneContact plane_contact(const PressedLayer& layer) {
  const double of_nu = layer.poisson_ratio / (1 - layer.poisson_ratio);
  const auto indentation_m = [&](double a) {
    return a * a / (4 * layer.radius_m) * (2 * std::log(2 * layer.depth_m / a) - of_nu);
  };
  double least = 0, most = 2 * layer.depth_m * std::exp(-(1 + of_nu) / 2);
  const double known_m = std::min(layer.indentation_m, indentation_m(most));
  for (int halving = 0; halving < 60; ++halving) {
    const double a = (least + most) / 2;
    (indentation_m(a) < known_m ? least : most) = a;
  }
  return {most, known_m};
}

}  // namespace

double solid_force_m2(const PressedLayer& layer) {
  const double nu = layer.poisson_ratio, alpha = -(1.2876 - 1.4678 * nu + 1.3442 * nu * nu) / (1 - nu),
               beta = (0.6387 - 1.0277 * nu + 1.5164 * nu * nu) / (1 - nu),
               radius_m = std::sqrt(layer.radius_m * layer.indentation_m), chi = radius_m / layer.depth_m,
               cube = alpha * alpha * alpha;
  const double layered = 1 - 2 * alpha / pi * chi + 4 * alpha * alpha / (pi * pi) * chi * chi -
                         8 / std::pow(pi, 3) * (cube + 4 * pi * pi / 15 * beta) * std::pow(chi, 3) +
                         16 * alpha / std::pow(pi, 4) * (cube + 3 * pi * pi / 5 * beta) * std::pow(chi, 4);
  return 4.0 / 3 * plane_strain_modulus(layer) * radius_m * layer.indentation_m * layered;
}

double plane_force_m(const PressedLayer& layer) {
  const auto [a, known_m] = plane_contact(layer);
  return pi * plane_strain_modulus(layer) * a * a / (4 * layer.radius_m) * layer.indentation_m / known_m;
}

double dimension_half_width(const PressedLayer& layer, double thickness_m, double spread) {
  const double layered = solid_force_m2(layer) / (thickness_m * plane_force_m(layer)),
               wide = plane_contact(layer).a_m / layer.depth_m,
               spreads = std::exp(kOfForms + kOfWide * wide * wide + kOfSpread * spread / (1 + spread));
  return std::max(std::abs(layered * spreads - 1), std::abs(layered / spreads - 1));
}

}  // namespace teletact::service
