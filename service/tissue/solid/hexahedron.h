// Stiffness of one rectangular trilinear element (Q1) with T4's selective reduced integration:
//   K_e = Int 2 mu eps(v):eps(u)  (exact)  +  lambda |e| div(v) div(u) at the centre.
#pragma once

#include <Eigen/Core>

namespace teletact::service {

using HexahedronMatrix = Eigen::Matrix<double, 24, 24>;

// N/m for a modulus of 1 Pa. Corner (a_x, a_y, a_z), each 0 or 1, is number a_x + 2 a_z + 4 a_y: those of the
// upper side first. Freedoms [u_x, u_y, u_z] per corner. Sizes in metres > 0, 0 <= poisson_ratio < 0.5 (not
// checked here).
HexahedronMatrix hexahedron_stiffness(double size_x_m, double size_y_m, double size_z_m,
                                      double poisson_ratio);

}  // namespace teletact::service
