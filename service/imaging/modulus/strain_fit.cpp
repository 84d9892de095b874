#include "service/imaging/modulus/strain_fit.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <vector>

#include "service/imaging/tracking/median.h"

namespace teletact::service {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

constexpr double kTextureLog = 0.1;  // of ln E of what still looks homogeneous
constexpr int kReweighted = 12;
constexpr double kUsualTilt = 0.3, kUsualGrading = 1;
constexpr double kMinRest = 0.02;

}  // namespace

StrainFit fit_strain(const VectorXd& residual, const VectorXd& weight, const VectorXd& by_tilt,
                     const VectorXd& depth) {
  std::vector<double> used;
  for (Index c = 0; c < residual.size(); ++c)
    if (weight[c] > 0) used.push_back(residual[c]);
  StrainFit out;
  out.level = median(used), out.rest = kTextureLog;
  Eigen::Matrix3d normal;
  for (int k = 0; k < kReweighted; ++k) {
    // Cauchy's weights: lumps are left out.
    normal.setZero();
    Eigen::Vector3d load = Eigen::Vector3d::Zero();
    const Eigen::Vector3d now(out.level, out.tilt, out.grading);
    std::vector<double> sizes;
    for (Index c = 0; c < residual.size(); ++c) {
      if (!(weight[c] > 0)) continue;
      const Eigen::Vector3d f(1, -by_tilt[c], depth.size() ? depth[c] : 0);
      const double left = residual[c] - now.dot(f), share = 1 / (1 + squared(left / (1.5 * out.rest)));
      normal += share * f * f.transpose(), load += share * residual[c] * f;
      sizes.push_back(std::abs(left));
    }
    normal(1, 1) += squared(out.rest / kUsualTilt), normal(2, 2) += squared(out.rest / kUsualGrading);
    const Eigen::Vector3d solution = normal.fullPivLu().solve(load);
    out.level = solution[0], out.tilt = solution[1], out.grading = solution[2];
    out.rest = std::max(1.48 * median(sizes), kMinRest);
  }
  out.tilt_deviation = out.rest * std::sqrt(std::max(0.0, normal.inverse()(1, 1)));
  return out;
}

}  // namespace teletact::service
