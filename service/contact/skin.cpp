#include "service/contact/skin.h"

#include <cmath>

#include "service/contact/fingertip.h"

namespace teletact::service {

SkinThickness skin_thickness(const Fingertip& tip, double indentation_m, double width_m) {
  const double d = indentation_m, h = width_m;
  const double round = std::sqrt(2 * tip.radius_m * d);
  const double by_d = tip.radius_m / round, by_d2 = -by_d / (2 * d);  // of the half overlap flat + round
  const double sum = h + flat_half_m(tip) + round, share = h / sum;
  const double share_by_d = -share * by_d / sum;
  const double share_by_d2 = -share * by_d2 / sum + 2 * share * by_d * by_d / (sum * sum);
  return {d * share, share + d * share_by_d, 2 * share_by_d + d * share_by_d2};
}

SkinState skin_state(double p, double stiffness, double thickness_m) {
  const double load = p / (stiffness * thickness_m);  // (1 - s)^2 / s
  const double root = std::sqrt(load * (load + 4)), s = 2 / (load + 2 + root);
  SkinState state;
  state.s = s;
  state.rest = s * (load + root) / 2;  // without cancellation
  state.gap_m = thickness_m * (s - kSkinMiddle);
  state.compliance = s * s / (state.rest * (1 + s) * stiffness);
  state.gap_by_t = 2 * s / (1 + s) - kSkinMiddle;
  return state;
}

SkinEnergy skin_energy(const SkinState& state, double p, double stiffness, double thickness_m) {
  const double excess = -state.rest - std::log(state.s), square = state.rest * state.rest;  // s - 1 - ln s
  return {stiffness * thickness_m * thickness_m * (excess - square / 2) + p * state.gap_m,
          2 * stiffness * thickness_m * excess - kSkinMiddle * p,
          2 * stiffness * (excess - square / (1 + state.s))};
}

}  // namespace teletact::service
