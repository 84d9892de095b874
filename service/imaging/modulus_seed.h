// What the direct and the iterative modulus share: a first map that a forward solve can use, and the scale.
#pragma once

#include "service/imaging/modulus.h"
#include "service/imaging/strip_model.h"
#include "service/imaging/window_nodes.h"

namespace teletact::service {

// Area over which errors of the displacement agree: a tracking window.
inline constexpr double kTrackingWindowM2 = 1.6e-3 * 1.2e-3;

// A forward solve with the modulus of a map, and how far the probe was pushed: the median over the window of
// measured over modelled axial strain.
struct ForwardSolve {
  std::vector<double> youngs_modulus_pa;  // of the strip's elements
  StripResponse response;                 // to a push of 1 m
  ModelState state;                       // the same on the window's nodes
  double amplitude_m = 0;                 // how far the probe was pushed into the tissue
};

// |log(E / background)| below the first is background, above the second it counts fully, between linearly.
struct Shrink {
  double below, above;
};
void shrink(std::vector<double>& youngs_modulus, double background, Shrink);

// `map`: what the elements are taken from (StripModel::on_elements), shrunk. Throws NoCompression when
// nothing was measured.
ForwardSolve solve_forward(StripModel&, const ModulusInput&, const ModulusEstimate& map, const AxialSlopes&,
                           Shrink);

// True modulus over that of the forward solve, from the sensor's force; 1 without a force.
double force_scale(const ModulusInput&, const ForwardSolve&);

// Median over what is said -> background; a relative map is divided by it. Throws NoCompression when nothing
// is said.
void normalise(ModulusEstimate&);

}  // namespace teletact::service
