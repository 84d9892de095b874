// The solid patient's own discretisation: Q1 hexahedra on lines of their own, fine under the probe and about
// the lumps, coarser beyond. Node (i, j, k) at (x_m[i], y_m[j], z_m[k]), j = 0 the surface; element (i, j, k)
// between nodes (i, j, k) and (i+1, j+1, k+1).
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "client/patient/displacement_field.h"
#include "client/patient/tissue.h"

namespace teletact::client {

struct SolidMesh {
  std::vector<double> x_m, y_m, z_m;      // y_m goes on through the bed, if there is one
  std::vector<double> youngs_modulus_pa;  // per element: the mean of the true modulus over its volume
  double poisson_ratio = 0;
  bool half = false;  // z_m begins at z = 0, the image plane, about which all is symmetric

  std::size_t nx() const { return x_m.size(); }
  std::size_t ny() const { return y_m.size(); }
  std::size_t nz() const { return z_m.size(); }
  std::size_t nodes() const { return nx() * ny() * nz(); }
  std::size_t node(std::size_t i, std::size_t j, std::size_t k) const { return j + ny() * (i + nx() * k); }
  std::size_t element(std::size_t i, std::size_t j, std::size_t k) const {
    return j + (ny() - 1) * (i + (nx() - 1) * k);
  }
};

// Of tissue with a solid, for a probe whose face begins at window_x_m, its middle at window_z_m: spacing_m
// along x, 0.7 of it along y and z where it is fine, which is near the face and about lumps that reach there;
// a tenth at the face's borders, up to twice as wide below and six times beside. Throws TissueError above two
// million nodes.
SolidMesh make_solid_mesh(const Tissue& tissue, double window_x_m, double spacing_m, double window_z_m = 0);

// Stiffness of a box of such sides and unit Young's modulus: 2 mu eps:eps by 2 x 2 x 2 Gauss points, lambda
// (div u)^2 at the centre. Order: nodes (0,0,0), (1,0,0), (0,1,0), (1,1,0), then those of z = 1, each u_x,
// u_y, u_z; row-major.
std::array<double, 576> box_stiffness(const std::array<double, 3>& sides_m, double poisson_ratio);

// A displacement on the mesh, trilinear between its nodes.
class SolidField : public DisplacementField {
 public:
  // `u` holds u_x, u_y, u_z of each node.
  SolidField(const SolidMesh& mesh, std::vector<double> u);
  using DisplacementField::at;
  Vector at(double x_m, double y_m, double z_m) const override;

 private:
  SolidMesh mesh_;
  std::vector<double> u_;
};

}  // namespace teletact::client
