// A field of cells by a few columns: what most cells agree on, lumps left out.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <vector>

#include "service/base/squared.h"

namespace teletact::service {

struct FitColumn {
  Eigen::VectorXd by;    // of the field, per unit
  double usual = 0;      // what is known of its number beforehand,
  double deviation = 1;  // and how well
  // Whether that may be wrong: what is many deviations away then counts little more (Cauchy).
  bool doubted = false;
  double reach = HUGE_VAL;  // of its number, about, as far as the column is true
};

struct RobustFit {
  Eigen::VectorXd at;          // of each column
  Eigen::MatrixXd covariance;  // of those
  Eigen::VectorXd left;        // of the field, 0 where nothing was told
  double rest = 0;             // its typical size
  // - ln of the evidence (Laplace), but for what fits of one field at one scale share.
  double misfit = 0;
};

// Where `told` is above 0, by Cauchy's weights, from numbers of 0 on. `places`: of a cell, by what is
// independent in it. `scale`: what a cell is off by where the columns explain it; 0: what is found to be
// left.
RobustFit fit_robustly(const Eigen::VectorXd& field, const Eigen::VectorXd& told,
                       const std::vector<FitColumn>& columns, double places, double scale = 0);

// So many fields at most whose products make up those of the columns, but for little.
std::vector<Eigen::VectorXd> principal(const Eigen::MatrixXd& columns, std::size_t most);

}  // namespace teletact::service
