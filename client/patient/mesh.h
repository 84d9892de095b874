// The patient's own discretisation: Q1 quadrilaterals of 0.5 mm (the service uses 1 mm), coarser in depth
// below every inclusion. Node (i, j) at (x_m[i], y_m[j]), j = 0 the surface; element (i, j) between nodes (i,
// j) and (i+1, j+1), at i + (nx-1) j.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "client/patient/displacement_field.h"
#include "client/patient/tissue.h"

namespace teletact::client {

struct PatientMesh {
  std::vector<double> x_m, y_m;
  std::vector<double> youngs_modulus_pa;  // per element: the mean of the true modulus over its area
  double poisson_ratio = 0;
  std::size_t nx() const { return x_m.size(); }
  std::size_t ny() const { return y_m.size(); }
  double modulus(std::size_t i, std::size_t j) const { return youngs_modulus_pa[i + (nx() - 1) * j]; }
};

// Squares of `spacing_m` down to 2 mm below the deepest inclusion (at least 25 mm), below that growing to
// twice as tall. Throws TissueError when its factor would need more than 4 GB.
PatientMesh make_mesh(const Tissue& tissue, double spacing_m);

// Stiffness of a dx x dy rectangle of unit Young's modulus, plane strain: 2 mu eps:eps by 2 x 2 Gauss points,
// lambda (div u)^2 at the centre (T4: does not lock). Order: nodes (0,0), (1,0), (0,1), (1,1), each u_x, u_y;
// row-major.
std::array<double, 64> element_stiffness(double dx_m, double dy_m, double poisson_ratio);

// A displacement on the mesh, bilinear between its nodes, the same at every z.
class PlaneField : public DisplacementField {
 public:
  // `u` holds u_x, u_y of node (i, j) at 2 (j + ny i): column after column along x.
  PlaneField(const PatientMesh& mesh, std::vector<double> u);
  using DisplacementField::at;
  Vector at(double x_m, double y_m, double z_m) const override;

 private:
  std::vector<double> x_m_, y_m_, u_;
};

}  // namespace teletact::client
