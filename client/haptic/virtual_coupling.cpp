#include "client/haptic/virtual_coupling.h"

#include <cmath>
#include <stdexcept>

namespace teletact::client {

double coupling_damping_n_s_m(double tissue_n_m, double period_s) noexcept {
  constexpr double kStiffestHandNM = 1000;
  return 0.5 * period_s * (tissue_n_m + kStiffestHandNM);
}

VirtualCoupling::VirtualCoupling(const VirtualCouplingOptions& options, const Vector3& position_m)
    : options_(options), tool_{position_m, Vector3::Zero()} {
  if (!(options.mass_kg > 0) || !(options.damping_n_s_m > 0))
    throw std::invalid_argument("virtual coupling: mass_kg and damping_n_s_m must be above zero");
}

// v(t) = F/b + (v - F/b) e^(-t/tau), tau = m/b
void VirtualCoupling::step(const Vector3& hand_force_n, const Vector3& rendered_force_n,
                           double dt_s) noexcept {
  const Vector3 force_n = hand_force_n + rendered_force_n;
  const Vector3 drift_m_s = (force_n.allFinite() ? force_n : Vector3::Zero()) / options_.damping_n_s_m;
  const double tau_s = options_.mass_kg / options_.damping_n_s_m;
  const double left = std::exp(-dt_s / tau_s);
  const Vector3 excess_m_s = tool_.velocity_m_s - drift_m_s;
  tool_.position_m += dt_s * drift_m_s + tau_s * (1 - left) * excess_m_s;
  tool_.velocity_m_s = drift_m_s + left * excess_m_s;
}

}  // namespace teletact::client
