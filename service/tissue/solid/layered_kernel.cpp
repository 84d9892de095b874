#include "service/tissue/solid/layered_kernel.h"

#include <Eigen/Core>
#include <Eigen/LU>
#include <cmath>

namespace teletact::service {
namespace {

// A layer's stiffness by wave number over E s: tractions on it over displacements [u, w] of its upper side,
// then of its lower one, u = U(y) sin(s x), w = W(y) cos(s x). Its solutions are e^-q [1, 1] and
// e^-q [q, q + k], q = s y from the upper side, k = 3 - 4 nu, and their mirror images from the lower one.
Eigen::Matrix4d layer_stiffness(double q_below, double nu) {
  const double k = 3 - 4 * nu, mu = 1 / (2 * (1 + nu)), lambda = nu / ((1 + nu) * (1 - 2 * nu));
  Eigen::Matrix4d moved, traction;
  // f: of e^-q at that side; q from where it is 1; towards: 1 down, -1 up; out: of the side's normal.
  const auto put = [&](int side, int column, double q, double f, double towards, double out) {
    const Eigen::Vector2d u(f, q * f), w(f, (q + k) * f);
    const Eigen::Vector2d du(-f, (1 - q) * f), dw(-f, (1 - q - k) * f);  // by q
    for (int n = 0; n < 2; ++n) {
      moved(2 * side, column + n) = u[n];
      moved(2 * side + 1, column + n) = towards * w[n];
      // of sin: shear mu (U' - W); of cos: (lambda + 2 mu) W' + lambda U; per s
      traction(2 * side, column + n) = out * towards * mu * (du[n] - w[n]);
      traction(2 * side + 1, column + n) = out * ((lambda + 2 * mu) * dw[n] + lambda * u[n]);
    }
  };
  const double f = std::exp(-q_below);
  put(0, 0, 0, 1, 1, -1);
  put(1, 0, q_below, f, 1, 1);
  put(0, 2, q_below, f, -1, -1);
  put(1, 2, 0, 1, -1, 1);
  return traction * moved.inverse();
}

}  // namespace

double layered_kernel(const LayerStack& stack, double s) {
  Eigen::Matrix2d below;  // stiffness of what lies under a layer, over s
  for (std::size_t n = stack.thickness_m.size(); n-- > 0;) {
    const double e = stack.youngs_modulus_pa[n];
    const Eigen::Matrix4d k = e * layer_stiffness(s * stack.thickness_m[n], stack.poisson_ratio);
    const bool ground = n + 1 == stack.thickness_m.size();
    const Eigen::Matrix2d upper = k.topLeftCorner<2, 2>();
    if (ground) {
      below = upper;
      continue;
    }
    const Eigen::Matrix2d joined = k.bottomRightCorner<2, 2>() + below;
    below = upper - k.topRightCorner<2, 2>() * joined.inverse() * k.bottomLeftCorner<2, 2>();
  }
  const double nu = stack.poisson_ratio;
  return below.inverse()(1, 1) * stack.youngs_modulus_pa.front() / (2 * (1 - nu * nu));
}

}  // namespace teletact::service
