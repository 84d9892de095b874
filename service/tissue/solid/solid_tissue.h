// A block of solid tissue (T8): hexahedra, uniform along x and z, graded along y.
//
// x and z are periodic: the block's far end meets its near one, so what is touched needs tissue around it.
// y points into the tissue, y_m[0] the surface, the last row of nodes held. Node (i, j, k) lies at
// (i spacing_x_m, y_m[j], k spacing_z_m); element (i, j, k) begins there.
#pragma once

#include <Eigen/Core>

#include <array>
#include <cstddef>
#include <vector>

namespace teletact::service {

struct SolidGrid {
  std::size_t nx = 0, nz = 0;  // of nodes and of elements: powers of two
  double spacing_x_m = 0, spacing_z_m = 0;
  std::vector<double> y_m;                               // strictly increasing, >= 2
  bool slides = false;                                   // on its lowest layer, which stands for rollers
  std::size_t layers() const { return y_m.size() - 1; }  // of elements; of rows of nodes that are free
  std::size_t columns() const { return nx * nz; }
  std::size_t elements() const { return columns() * layers(); }
  std::size_t unknowns() const { return 3 * elements(); }
  bool operator==(const SolidGrid&) const = default;
};

struct SolidTissue {
  SolidGrid grid;
  std::vector<double> youngs_modulus_pa;  // [layer][z][x], > 0
  double poisson_ratio = 0.49;            // 0 <= . < 0.5
};

// Throws std::invalid_argument naming the field.
void validate(const SolidTissue&);

// What the tissue is compared with: E0(y), the geometric mean of each layer, and the least and the largest
// E / E0 of any element. The eigenvalues of K(E0)^-1 K(E) lie between them (T4.6).
struct LayeredTissue {
  std::vector<double> youngs_modulus_pa;  // of each layer
  double least = 1, largest = 1;
};
LayeredTissue layered(const SolidTissue&);
// The tissue that is layered so.
SolidTissue solid_of(const SolidGrid&, const LayeredTissue&, double poisson_ratio);
// The same beside another E0, one for each layer: both bounds of E / E0 are this tissue's.
LayeredTissue beside(const SolidTissue&, const std::vector<double>& layers_pa);

// Stiffness of one rectangular trilinear element (Q1) with T4's selective reduced integration:
//   K_e = Int 2 mu eps(v):eps(u)  (exact)  +  lambda |e| div(v) div(u) at the centre.
using HexahedronMatrix = Eigen::Matrix<double, 24, 24>;

// N/m for a modulus of 1 Pa. Corner (a_x, a_y, a_z), each 0 or 1, is number a_x + 2 a_z + 4 a_y: those of the
// upper side first. Freedoms [u_x, u_y, u_z] per corner. Sizes in metres > 0, 0 <= poisson_ratio < 0.5 (not
// checked here).
HexahedronMatrix hexahedron_stiffness(double size_x_m, double size_y_m, double size_z_m,
                                      double poisson_ratio);

// Of an element of a layer. Rollers are a bed of springs between its sides: dx dz / dy, 100 times along y and
// 1e-3 times along x and z. Softer ones, and double precision loses digits at nu 0.4999.
HexahedronMatrix layer_stiffness(const SolidGrid&, std::size_t layer, double poisson_ratio);

// The same by parity: B with K_e = H^T B H. H adds a component up over the corners, with a sign (2 a - 1) for
// each direction that the parity is odd in: bit 0 for x, 1 for y, 2 for z. A box of one modulus is its own
// mirror image, so component p of parity s ^ 1 << p, p = x, y, z, meets only its like of the same s:
// 8 blocks [s] of 3 x 3.
std::array<double, 72> parity_blocks(const HexahedronMatrix&);

}  // namespace teletact::service
