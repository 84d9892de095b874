// What the answers of a plane may be off by (T9.4, T9.7).
#pragma once

#include <string>
#include <vector>

#include "service/contact/plane_dimension.h"
#include "service/contact/touch_model.h"
#include "service/tissue/tissue_problem.h"

namespace teletact::service {

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
