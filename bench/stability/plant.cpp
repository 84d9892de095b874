#include "bench/stability/plant.h"

#include <cmath>
#include <complex>

namespace teletact::bench {
namespace {

// exp(A t) of m y'' + B y' + k y = 0 on [y, y'], by the two roots; equal ones are kept apart by a rounding.
Eigen::Matrix2d propagator(const PlantOptions& o, double time_s) {
  const double decay = (o.damping_n_s_m + o.hand_damping_n_s_m) / (2 * o.mass_kg);
  const double square = decay * decay - o.hand_stiffness_n_m / o.mass_kg;
  const std::complex<double> root = std::sqrt(std::complex<double>(square + 1e-9 * std::abs(square)));
  // cosh and sinh of the root, real for either sign of the square
  const double c = std::cosh(root * time_s).real();
  const double s = (std::sinh(root * time_s) / root).real();
  Eigen::Matrix2d m;
  m << c + decay * s, s, -o.hand_stiffness_n_m / o.mass_kg * s, c - decay * s;
  return std::exp(-decay * time_s) * m;
}

}  // namespace

Plant::Plant(const PlantOptions& options, const Vector3& position_m)
    : options_(options),
      whole_(propagator(options, options.step_s)),
      half_(propagator(options, options.step_s / 2)),
      position_m_(position_m) {}

void Plant::step(const Vector3& force_n, const HandTarget& target) noexcept {
  const PlantOptions& o = options_;
  // In the target's frame: m y'' + (b + b_h) y' + k_h y = F - b r' - friction
  Vector3 load_n = force_n - o.damping_n_s_m * target.velocity_m_s;
  const Vector3 offset_m = position_m_ - target.position_m;
  const Vector3 slip_m_s = velocity_m_s_ - target.velocity_m_s;
  const double speed_m_s = velocity_m_s_.norm();
  if (speed_m_s > 0) {
    load_n -= o.friction_n / speed_m_s * velocity_m_s_;
  } else if (o.friction_n > 0) {
    const Vector3 pull_n = load_n - o.hand_stiffness_n_m * offset_m +
                           (o.damping_n_s_m + o.hand_damping_n_s_m) * target.velocity_m_s;
    if (pull_n.norm() <= o.friction_n) return;  // sticks: no motion, no work
    load_n -= o.friction_n / pull_n.norm() * pull_n;
  }
  const Vector3 equilibrium_m = load_n / o.hand_stiffness_n_m;
  Eigen::Matrix<double, 2, 3> state;  // rows: distance, velocity; columns: x, y, z
  state << (offset_m - equilibrium_m).transpose(), slip_m_s.transpose();
  const Eigen::Matrix<double, 2, 3> after = whole_ * state;
  const Vector3 middle_m_s = (half_.row(1) * state).transpose() + target.velocity_m_s;
  const Vector3 before_m = position_m_, before_m_s = velocity_m_s_;
  position_m_ =
      target.position_m + o.step_s * target.velocity_m_s + equilibrium_m + Vector3(after.row(0).transpose());
  velocity_m_s_ = Vector3(after.row(1).transpose()) + target.velocity_m_s;
  // Int b v^2 dt by Simpson's rule; the held force's work is exact.
  const double squares =
      before_m_s.squaredNorm() + 4 * middle_m_s.squaredNorm() + velocity_m_s_.squaredNorm();
  const Vector3 moved_m = position_m_ - before_m;
  port_energy_j_ += o.damping_n_s_m * o.step_s * squares / 6 - force_n.dot(moved_m);
  if (o.friction_n > 0) {
    port_energy_j_ += o.friction_n * moved_m.norm();
    // Friction stops a mass, it never turns it.
    if (speed_m_s > 0 && velocity_m_s_.dot(before_m_s) < 0) velocity_m_s_.setZero();
  }
}

}  // namespace teletact::bench
