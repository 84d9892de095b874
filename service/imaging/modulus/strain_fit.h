// What the axial strain of homogeneous tissue does not have, fitted to what was measured (T3.6): a level, a
// tilt of the face, and a modulus that changes with depth.
#pragma once

#include <Eigen/Core>

namespace teletact::service {

inline double squared(double v) {
  return v * v;
}

// ln(modelled / measured) over the cells told, robustly: a level, and so much tilt and grading more that
// explain it.
struct StrainFit {
  double level = 0, tilt = 0, tilt_deviation = 0;
  double grading = 0;  // of ln E, per unit of depth
  double rest = 0;     // typical size of what is left
};
// `residual` of the cells, their weights (0: not told), what ln of the strain gains per unit of tilt, and
// their depths, in any unit and from anywhere; empty: the modulus does not change with depth.
StrainFit fit_strain(const Eigen::VectorXd& residual, const Eigen::VectorXd& weight,
                     const Eigen::VectorXd& by_tilt, const Eigen::VectorXd& depth = {});

}  // namespace teletact::service
