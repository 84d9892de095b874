// What the answers of a plane may be off by (T9.4, T9.7).
#pragma once

#include <string>
#include <vector>

#include "service/contact/touch_model.h"
#include "service/tissue/tissue_problem.h"

namespace teletact::service {

// What a plane leaves out of a round tip on a solid: the third dimension (T9.7). Closed forms of a
// frictionless round tip on a homogeneous layer that is bonded to its support.
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

// Of one plane, of frictionless rounded tips on its surface.
class PlaneBudget {
 public:
  explicit PlaneBudget(const TissueProblem&);
  // To an answer there.
  void add(const Fingertip&, double x_m, double indentation_m, ContactAnswer&) const;
  // What a solid differs from it by, in a sentence.
  std::string words() const;

 private:
  PressedLayer pressed(const Fingertip&, double indentation_m) const;
  bool wide_around(double x_m) const;  // the closed forms are of wide tissue with a free surface, held below
  double thickness_m_, poisson_ratio_, first_row_m_;
  bool free_on_held_;        // its surface is free, its bottom held
  std::vector<double> x_m_;  // of the columns of nodes
  double depth_m_;
  std::vector<double> spreads_;  // standard deviation of ln E over what is felt at each column
};

}  // namespace teletact::service
