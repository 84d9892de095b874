// What the iterative modulus minimises (T3.3), in the plainest form: whole matrices, no adjoint, no variable
// projection, plane stress by its own Lame constants.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "service/tissue/grid.h"

namespace teletact::reference {

// Axial displacement at (x, y) of the strip.
struct AxialDatum {
  double x_m, y_m, displacement_m, deviation_m;
};

// Element (i, j) at i + (nx - 1) j. The probe pushes the surface nodes first_column .. last_column by 1 m;
// the bottom rests; amplitude and offset are those that fit best.
struct ModulusObjective {
  service::TissueGrid grid;
  std::size_t first_column = 0, last_column = 0;
  double poisson_ratio = 0;
  bool plane_stress = false;
  double background_pa = 1;
  std::vector<AxialDatum> data;
  double independence = 1;  // part of an observation that each datum counts for
  double tv = 0, tv_floor_per_m = 1;
  Eigen::VectorXd prior, prior_weight;

  Eigen::VectorXd displacement(const Eigen::VectorXd& log_modulus) const;  // [dof]
  double variation(const Eigen::VectorXd& log_modulus) const;              // without tv
  double value(const Eigen::VectorXd& log_modulus) const;
};

}  // namespace teletact::reference
