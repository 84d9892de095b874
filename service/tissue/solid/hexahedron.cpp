#include "service/tissue/solid/hexahedron.h"

#include <array>

namespace teletact::service {
namespace {

// Integrals over one side of length h of products of its two linear shape functions or their slopes.
double integral(double h, int a, int b, bool slope_of_a, bool slope_of_b) {
  const double sign_a = a ? 1 : -1, sign_b = b ? 1 : -1;
  if (slope_of_a && slope_of_b) return sign_a * sign_b / h;
  if (slope_of_a) return sign_a / 2;
  if (slope_of_b) return sign_b / 2;
  return a == b ? h / 3 : h / 6;
}

}  // namespace

HexahedronMatrix hexahedron_stiffness(double size_x_m, double size_y_m, double size_z_m,
                                      double poisson_ratio) {
  const std::array<double, 3> size{size_x_m, size_y_m, size_z_m};
  const double volume = size[0] * size[1] * size[2];
  const double mu = 1 / (2 * (1 + poisson_ratio));
  const double lambda = 2 * mu * poisson_ratio / (1 - 2 * poisson_ratio);
  const auto corner = [](int n) { return std::array<int, 3>{n & 1, n >> 2, (n >> 1) & 1}; };  // x, y, z
  HexahedronMatrix k;
  for (int m = 0; m < 8; ++m) {
    for (int n = 0; n < 8; ++n) {
      const auto a = corner(m), b = corner(n);
      // Int dN_m/dp dN_n/dq
      const auto product = [&](int p, int q) {
        double value = 1;
        for (int s = 0; s < 3; ++s)
          value *= integral(size[static_cast<std::size_t>(s)], a[static_cast<std::size_t>(s)],
                            b[static_cast<std::size_t>(s)], s == p, s == q);
        return value;
      };
      // 2 mu eps(v):eps(u) = mu (dv_p/dq du_p/dq + dv_p/dq du_q/dp)
      const double gradients = product(0, 0) + product(1, 1) + product(2, 2);
      for (int p = 0; p < 3; ++p)
        for (int q = 0; q < 3; ++q) k(3 * m + p, 3 * n + q) = mu * (product(q, p) + (p == q ? gradients : 0));
    }
  }
  Eigen::Matrix<double, 24, 1> divergence;
  for (int m = 0; m < 8; ++m)
    for (int p = 0; p < 3; ++p) {
      const auto s = static_cast<std::size_t>(p);
      divergence[3 * m + p] = (corner(m)[s] ? 1 : -1) / (4 * size[s]);
    }
  k += lambda * volume * divergence * divergence.transpose();
  return k;
}

}  // namespace teletact::service
