// What slices tell of the planes beyond them (T3.9).
#pragma once

#include <Eigen/Core>

#include "service/imaging/modulus/probed_tissue.h"

namespace teletact::service {

// `beside`, the other slices, and what the outermost of all tell of the tissue beyond them: it extends across
// the image as far as along it. A lump gets the volume of a ball, a layer goes on. `log_modulus`: of the
// cells, about the background. As `beside` where planes cannot be told apart.
ProbedTissue::Planes planes_beyond(ProbedTissue::Planes beside, const Eigen::VectorXd& log_modulus,
                                   const ProbedTissue&);

}  // namespace teletact::service
