// How stiff tissue is where its surface is touched, about (T8.4): ln(E / E0) of what lies around and below a
// node, weighted by the share of the energy that a contact there leaves in it, were the tissue layered. S0
// with its smooth part scaled by that, S0 + D S_l D - S_l, is nearer to S than S0.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "service/tissue/solid/element_shares.h"
#include "service/tissue/solid/solid_tissue.h"

namespace teletact::service {

// Of each node of the surface, [z][x].
struct FeltModulus {
  // D = exp(-m/2), m the mean of ln(E / E0): exactly 1 where all tissue is layered.
  Eigen::VectorXd scale;
  // What D S0 D may be off by there over itself: the same shares bound S between the mean of E0 / E (stress
  // as it is in layered tissue) and one over that of E / E0 (strain as it is there).
  Eigen::VectorXd beyond;
};

// The shares, of a factor's layers; one thread at a time, as its queue.
class EnergyShares {
 public:
  // A usual contact, Hertz's pressure of radius 4 mm about node 0, by unknown of the surface (SurfacePatch).
  struct Load {
    std::vector<std::size_t> unknowns;
    Eigen::VectorXd force_n;
  };
  static Load usual_load(const SolidGrid&);
  // `displacement_m`: of layered tissue under the usual load, [plane = 3 row + component][z][x].
  EnergyShares(const Queue&, const SolidGrid&, const LayeredTissue&, double poisson_ratio,
               const std::vector<double>& displacement_m);
  // Of tissue beside these layers, whose E0 is theirs over `softer`.
  FeltModulus felt(const SolidTissue&, double softer = 1);

 private:
  std::size_t columns_;
  std::vector<double> layers_pa_;
  ElementMeans means_;
  ElementMeans::Map shares_;
};

}  // namespace teletact::service
