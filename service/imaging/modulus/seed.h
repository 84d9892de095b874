// What the direct and the iterative modulus share: a first map that a forward solve can use, and the scale.
#pragma once

#include <Eigen/Core>

#include "service/imaging/modulus/modulus.h"
#include "service/imaging/modulus/strip_model.h"
#include "service/imaging/modulus/window_nodes.h"

namespace teletact::service {

// Area over which errors of the displacement agree: a tracking window.
inline constexpr double kTrackingWindowM2 = 1.6e-3 * 1.2e-3;

// |log(E / background)| below the first is background, above the second it counts fully, between linearly.
struct Shrink {
  double below, above;
};

// log(E / background) of the strip's elements that a forward solve is given for a map: what
// StripModel::on_elements takes from it, shrunk.
Eigen::VectorXd shrunk_log_modulus(const StripModel&, const ModulusInput&, const ModulusEstimate& map,
                                   Shrink);

// Root mean square over the elements under the probe of a field of the strip's elements.
double rms_under_probe(const StripModel&, const Eigen::VectorXd&);

// A forward solve with a modulus, and how far the probe was pushed: the median over the window of measured
// over modelled axial strain.
struct ForwardSolve {
  StripResponse response;  // to a push of 1 m
  ModelState state;        // the same on the window's nodes
  double amplitude_m = 0;  // how far the probe was pushed into the tissue
};

// `log_modulus`: log(E / background) of the strip's elements. Throws NoCompression when nothing was measured.
ForwardSolve solve_forward(StripModel&, const Eigen::VectorXd& log_modulus, double background,
                           const AxialSlopes&);

// True modulus over that of the forward solve, from the sensor's force; 1 without a force.
double force_scale(const ModulusInput&, const ForwardSolve&);

// Throws std::invalid_argument naming the field.
void validate(const std::optional<ProbeForce>&);

// Median over what is said -> background; a relative map is divided by it. Throws NoCompression when nothing
// is said.
void normalise(ModulusEstimate&);

}  // namespace teletact::service
