// What slices tell of the planes beyond them (T3.9).
#pragma once

#include <Eigen/Core>
#include <vector>

#include "service/imaging/modulus/probed_tissue.h"
#include "service/imaging/modulus/tissue_extent.h"

namespace teletact::service {

// The other slices in the cells of this one, whose face lies top_m deep: ln E of each about its own
// background, within range_log, 0 where it says nothing. Their levels differ by their forces' errors.
ProbedTissue::Planes planes_told(const std::vector<SliceBeside>&, const ProbedTissue&, double top_m,
                                 double range_log);

// The other slices, each with this one's modulus where both show one lump: how far it extends they tell, how
// stiff it is this one does. Where this one shows much more, the others show the shadow of it, and nothing is
// there; where the others show much more, they are as they are.
ProbedTissue::Planes with_shared_lumps(ProbedTissue::Planes beside, const Eigen::VectorXd& log_modulus);

// `beside`, so, and planes between this slice and the nearest: a lump that those do not show ends as a ball.
ProbedTissue::Planes planes_between(ProbedTissue::Planes beside, const Eigen::VectorXd& log_modulus,
                                    const ProbedTissue&);

// `beside`, the other slices, and what the outermost of all tell of the tissue beyond them: it extends across
// the image as far as along it. A lump gets the volume of a ball, a layer goes on. `log_modulus`: of the
// cells, about the background. As `beside` where planes cannot be told apart.
ProbedTissue::Planes planes_beyond(ProbedTissue::Planes beside, const Eigen::VectorXd& log_modulus,
                                   const ProbedTissue&);

}  // namespace teletact::service
