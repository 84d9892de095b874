// Stiffness of one rectangular bilinear element (Q1) in plane strain, with T4's selective reduced
// integration:
//   K_e = Int 2 mu eps(v):eps(u)  (2x2 points, exact on a rectangle)  +  lambda |e| div(v) div(u) at the
//   centre.
#pragma once

#include <Eigen/Core>

namespace teletact::service {

// Nodes in the order (left top, right top, left bottom, right bottom), i.e. (i, j), (i+1, j), (i, j+1),
// (i+1, j+1) of the grid; degrees of freedom [u_x, u_y] per node. N/m per metre of thickness.
// `width_m` along x, `height_m` along y, `youngs_modulus_pa` > 0, 0 <= `poisson_ratio` < 0.5 (not checked
// here).
Eigen::Matrix<double, 8, 8> element_stiffness(double width_m, double height_m, double youngs_modulus_pa,
                                              double poisson_ratio);

}  // namespace teletact::service
