// Least-squares strain (T2.4) in double precision, by QR of the plane fit: what strain.cl is held against.
#pragma once

#include <cstddef>
#include <vector>

namespace teletact::reference {

// Displacement (m) of the nodes of an nx x ny grid, index i + nx j, and which of them can be trusted.
struct DisplacementField {
  int nx = 0, ny = 0;
  double dx_m = 1, dy_m = 1;
  std::vector<double> lateral, axial;
  std::vector<bool> trusted;
};

struct StrainTensor {
  bool determined = false;  // at least `min_fraction` of the kernel inside the grid trusted, and >= 4 nodes
  double lateral = 0, axial = 0, shear = 0;  // shear: tensor component
  double residual_m = 0;                     // rms of the axial displacement about the plane
};

// At node (i, j), kernel of (2 half_columns + 1) x (2 half_rows + 1) nodes cut at the grid's border.
StrainTensor least_squares_strain(const DisplacementField&, int i, int j, int half_columns, int half_rows,
                                  double min_fraction);

}  // namespace teletact::reference
