// What a plane leaves out of a round tip on a solid: the third dimension (T9.7). Closed forms of a
// frictionless round tip on a homogeneous layer that is bonded to its support.
#pragma once

namespace teletact::service {

struct PressedLayer {
  double poisson_ratio = 0.49;
  double depth_m = 0;        // of the layer
  double radius_m = 0;       // of the tip
  double indentation_m = 0;  // > 0
};

// Over Young's modulus, m^2: Dimitriadis et al., Biophys. J. 82, 2002, eq. 12. Of nu 0.49 off by 0.5 % where
// sqrt(R d) is less than a third of the depth, by 10 % where it is half of it.
double solid_force_m2(const PressedLayer&);
// In plane strain, for each metre of thickness, over Young's modulus, m (Johnson, Contact Mechanics,
// 1985, 5.8): off by 5 % where the contact's half-width is less than a fifth of the depth, 15 % at a third,
// two times at half. Deeper than it knows it goes on as it is there.
double plane_force_m(const PressedLayer&);

// Half of an interval that holds the solid's force, over the plane's of a thickness. spread: standard
// deviation of ln E over what is felt; lumps and layers push a solid back otherwise than a plane.
double dimension_half_width(const PressedLayer&, double thickness_m, double spread);

}  // namespace teletact::service
