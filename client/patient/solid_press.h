// The simulated patient of solid tissue (Tissue::solid): the rigid face of a probe, width x elevation,
// pressed into a block with free sides. Quasi-static, linear; double precision, conjugate gradients on finite
// elements that share nothing with the service's.
#pragma once

#include "client/patient/patient.h"
#include "client/patient/solid_mesh.h"

namespace teletact::client {

// Along x under the probe. The force is then 1 % too large, and what shows of it is halved by half of the
// spacing.
inline constexpr double kSolidSpacing = 0.0015;

// The face covers [window_x_m, window_x_m + probe.width_m] x window_z_m + [-1/2, 1/2] probe.elevation_m;
// every node under it that touches (Solid::preload_m) is pushed down by compression_m, times what
// Solid::uneven says. Friction is Coulomb's under a push that grows in proportion, so it is that of the whole
// push (smoothed where the tissue slides by less than a thousandth of it). The force is the change by the
// push. Throws TissueError for tissue without a solid; std::invalid_argument when the face reaches beyond the
// tissue or compression_m is not in (0, depth / 10].
ProbeState press_solid(const Tissue& tissue, double window_x_m, double compression_m,
                       double spacing_m = kSolidSpacing, double window_z_m = 0);

}  // namespace teletact::client
