// Steps that the methods share: a first map that a forward solve can use, the strain that is enough, the
// scale.
#pragma once

#include <Eigen/Core>

#include "service/imaging/modulus/modulus.h"
#include "service/imaging/modulus/strip_model.h"
#include "service/imaging/modulus/window_nodes.h"

namespace teletact::service {

// Area over which errors of the displacement agree: a tracking window.
inline constexpr double kTrackingWindowM2 = 1.6e-3 * 1.2e-3;

inline constexpr double kMinStrain = 2e-4;  // magnitude; below it a node says nothing

// Median over the trusted nodes. Throws NoCompression when there are none, or its magnitude is below
// kMinStrain.
double mean_strain(std::vector<float> trusted_axial_strain);

// log(E / background) of the strip's elements that a forward solve is given for a map:
// StripModel::on_elements of it, shrunk (T3.2). Near the background it counts as background: the shadows that
// T3.1 throws above and below an inclusion would be given as truth.
Eigen::VectorXd shrunk_log_modulus(const StripModel&, const ModulusInput&, const ModulusEstimate& map);

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

// True modulus over the modelled one, P / (a P[E]) (T3.1): the sensor's force over that of the model, pushed
// by `amplitude_m`; 1 without a force.
double force_scale(const ModulusInput&, double modelled_n_per_m, double amplitude_m);

// Throws std::invalid_argument naming the field.
void validate(const std::optional<ProbeForce>&);

// Median over what is said -> background; a relative map is divided by it. Throws NoCompression when nothing
// is said.
void normalise(ModulusEstimate&);

}  // namespace teletact::service
