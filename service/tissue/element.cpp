#include "service/tissue/element.h"

namespace teletact::service {
namespace {

// The three integrals over one side of length h of products of the two linear shape functions N_0, N_1.
struct SideIntegrals {
  Eigen::Matrix2d mass;      // Int N_a N_b
  Eigen::Matrix2d gradient;  // Int N_a' N_b
  Eigen::Matrix2d slope;     // Int N_a' N_b'
};

SideIntegrals side_integrals(double h) {
  SideIntegrals s;
  s.mass << h / 3, h / 6, h / 6, h / 3;
  s.gradient << -0.5, -0.5, 0.5, 0.5;
  s.slope << 1 / h, -1 / h, -1 / h, 1 / h;
  return s;
}

}  // namespace

Eigen::Matrix<double, 8, 8> element_stiffness(double width_m, double height_m, double youngs_modulus_pa,
                                              double poisson_ratio) {
  const double mu = youngs_modulus_pa / (2 * (1 + poisson_ratio));
  const double lambda = 2 * mu * poisson_ratio / (1 - 2 * poisson_ratio);
  const SideIntegrals x = side_integrals(width_m), y = side_integrals(height_m);
  Eigen::Matrix<double, 8, 8> k;
  for (int a = 0; a < 4; ++a) {
    for (int b = 0; b < 4; ++b) {
      const int ax = a % 2, ay = a / 2, bx = b % 2, by = b / 2;
      const double dxdx = x.slope(ax, bx) * y.mass(ay, by);         // Int dN_a/dx dN_b/dx
      const double dydy = x.mass(ax, bx) * y.slope(ay, by);         // Int dN_a/dy dN_b/dy
      const double dxdy = x.gradient(ax, bx) * y.gradient(by, ay);  // Int dN_a/dx dN_b/dy
      const double dydx = x.gradient(bx, ax) * y.gradient(ay, by);  // Int dN_a/dy dN_b/dx
      // 2 mu eps:eps = mu (2 u_x,x v_x,x + 2 u_y,y v_y,y + (u_x,y + u_y,x)(v_x,y + v_y,x))
      k(2 * a, 2 * b) = mu * (2 * dxdx + dydy);
      k(2 * a, 2 * b + 1) = mu * dydx;
      k(2 * a + 1, 2 * b) = mu * dxdy;
      k(2 * a + 1, 2 * b + 1) = mu * (2 * dydy + dxdx);
    }
  }
  // div u at the centre times the area: u_x -+ height/2, u_y -+ width/2.
  Eigen::Matrix<double, 8, 1> divergence;
  divergence << -height_m, -width_m, height_m, -width_m, -height_m, width_m, height_m, width_m;
  divergence /= 2;
  k += (lambda / (width_m * height_m)) * divergence * divergence.transpose();
  return k;
}

}  // namespace teletact::service
